from .aruco import (
    board_bits as board_bits,
)
from .geometry import (
    grid_points_mm as grid_points_mm,
)
from .geometry import (
    zigzag_base_mm as zigzag_base_mm,
)
from .geometry import (
    zigzag_height as zigzag_height,
)
from .geometry import (
    zigzag_height_mm as zigzag_height_mm,
)
from .geometry import (
    zigzag_profile_mm as zigzag_profile_mm,
)
from .kinds_of_target import (
    REFERENCE_DEGC as REFERENCE_DEGC,
)
from .kinds_of_target import (
    Artefact as Artefact,
)
from .kinds_of_target import (
    BallBar as BallBar,
)
from .kinds_of_target import (
    Box as Box,
)
from .kinds_of_target import (
    Charuco as Charuco,
)
from .kinds_of_target import (
    Chessboard as Chessboard,
)
from .kinds_of_target import (
    Dots as Dots,
)
from .kinds_of_target import (
    Flat as Flat,
)
from .kinds_of_target import (
    LineGrid as LineGrid,
)
from .kinds_of_target import (
    Sphere as Sphere,
)
from .kinds_of_target import (
    Steps as Steps,
)
from .kinds_of_target import (
    Strips as Strips,
)
from .kinds_of_target import (
    Target as Target,
)
from .kinds_of_target import (
    Wedge as Wedge,
)
from .kinds_of_target import (
    Zigzag as Zigzag,
)
from .printable_sheet import (
    PRINTABLE as PRINTABLE,
)
from .printable_sheet import (
    sheet as sheet,
)
from .quantity import (
    Quantity as Quantity,
)
from .quantity import (
    Scalar as Scalar,
)
from .target_files import (
    list_targets as list_targets,
)
from .target_files import (
    load_target as load_target,
)
from .target_files import (
    parse_target as parse_target,
)
from .target_files import (
    read_target as read_target,
)
from .target_surface import (
    footprint_mm as footprint_mm,
)
from .target_surface import (
    step_edges_of as step_edges_of,
)
from .target_surface import (
    surface_mm as surface_mm,
)
from .tops import (
    BallTop as BallTop,
)
from .tops import (
    PlaneTop as PlaneTop,
)
from .tops import (
    Top as Top,
)
from .tops import (
    tops_of as tops_of,
)
from .vector import (
    pdf as pdf,
)
from .vector import (
    svg as svg,
)
