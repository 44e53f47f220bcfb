from .board_lens import (
    BoardPicture as BoardPicture,
)
from .board_lens import (
    KnownLens as KnownLens,
)
from .board_lens import (
    LensFindings as LensFindings,
)
from .board_lens import (
    lens_from_pictures as lens_from_pictures,
)
from .board_pose import (
    PosedBoard as PosedBoard,
)
from .board_pose import (
    RasterMap as RasterMap,
)
from .board_pose import (
    posed_board as posed_board,
)
from .grid_stage import (
    CameraFindings as CameraFindings,
)
from .grid_stage import (
    CameraKnowledge as CameraKnowledge,
)
from .grid_stage import (
    camera_from_grid as camera_from_grid,
)
from .grid_stage import (
    demand_possible_height as demand_possible_height,
)
from .posed_plates import (
    PosedPlate as PosedPlate,
)
from .posed_plates import (
    form_by_poses as form_by_poses,
)
from .rig_stage import (
    Calibrated as Calibrated,
)
from .rig_stage import (
    calibrate_surfaces as calibrate_surfaces,
)
from .standards import (
    CONTRADICTS as CONTRADICTS,
)
from .standards import (
    Standard as Standard,
)
from .statements_off import (
    STATED_OFF as STATED_OFF,
)
from .statements_off import (
    WrongStatement as WrongStatement,
)
from .statements_off import (
    wrong_statements as wrong_statements,
)
from .surfaces import (
    SURFACE_POINTS as SURFACE_POINTS,
)
from .surfaces import (
    PlateSurface as PlateSurface,
)
from .surfaces import (
    StripSurfaces as StripSurfaces,
)
from .surfaces import (
    plate_surface as plate_surface,
)
from .surfaces import (
    strips_on_plate as strips_on_plate,
)
