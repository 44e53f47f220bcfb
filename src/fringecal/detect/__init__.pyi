from .boards import (
    find_charuco as find_charuco,
)
from .boards import (
    find_chessboard as find_chessboard,
)
from .boards import (
    find_dots as find_dots,
)
from .boards import (
    refined_corners as refined_corners,
)
from .channel_contrast import (
    pattern_contrast as pattern_contrast,
)
from .dots import (
    find_dot_grid as find_dot_grid,
)
from .fringes.ridge import (
    Centres as Centres,
)
from .fringes.ridge import (
    ridge_centres as ridge_centres,
)
from .fringes.skeleton import (
    skeleton_centres as skeleton_centres,
)
from .grid.given_crossings import (
    grid_of_board as grid_of_board,
)
from .grid.given_crossings import (
    grid_of_crossings as grid_of_crossings,
)
from .grid.grid_search import (
    FAMILIES as FAMILIES,
)
from .grid.grid_search import (
    Family as Family,
)
from .grid.grid_search import (
    GridDetection as GridDetection,
)
from .grid.grid_search import (
    Polarity as Polarity,
)
from .grid.grid_search import (
    find_grid as find_grid,
)
from .grid.line_scatter import (
    LineScatter as LineScatter,
)
from .grid.line_section import (
    LineSection as LineSection,
)
from .grid.line_section import (
    line_section as line_section,
)
from .grid.ruling import (
    Ruling as Ruling,
)
from .grid.ruling import (
    ruling_of as ruling_of,
)
from .strips.strip_search import (
    StripRegions as StripRegions,
)
from .strips.strip_search import (
    find_strips as find_strips,
)
from .unknown_boards import (
    UnknownBoard as UnknownBoard,
)
from .unknown_boards import (
    board_in as board_in,
)
from .unknown_boards import (
    stretched as stretched,
)
