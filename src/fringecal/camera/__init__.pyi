from .distortion.check_points import (
    check_points as check_points,
)
from .distortion.check_points import (
    effect_of_neglect_px as effect_of_neglect_px,
)
from .distortion.distortion_test import (
    SIGNIFICANCE as SIGNIFICANCE,
)
from .distortion.distortion_test import (
    Centre as Centre,
)
from .distortion.distortion_test import (
    DistortionTest as DistortionTest,
)
from .distortion.distortion_test import (
    examine_distortion as examine_distortion,
)
from .distortion.grid_scale import (
    ThesisScale as ThesisScale,
)
from .distortion.grid_scale import (
    thesis_scale as thesis_scale,
)
from .distortion.line_spacing import (
    line_spacing_px as line_spacing_px,
)
from .distortion.ruled_pitch import (
    ruled_pitch as ruled_pitch,
)
from .distortion.straightness import (
    family_rms_px as family_rms_px,
)
from .lens.board_views import (
    board_view as board_view,
)
from .lens.brown_lens import (
    LENS_NAMES as LENS_NAMES,
)
from .lens.brown_lens import (
    Lens as Lens,
)
from .lens.lens_doubts import (
    Doubt as Doubt,
)
from .lens.lens_doubts import (
    lens_doubts as lens_doubts,
)
from .lens.lens_fit import (
    MIN_VIEWS as MIN_VIEWS,
)
from .lens.lens_fit import (
    LensFit as LensFit,
)
from .lens.lens_fit import (
    Solver as Solver,
)
from .lens.lens_fit import (
    fit_lens as fit_lens,
)
from .lens.lens_gradient import (
    SeenPoints as SeenPoints,
)
from .lens.lens_gradient import (
    lens_gradient as lens_gradient,
)
from .lens.lens_solve import (
    BoardView as BoardView,
)
from .lens.lens_solve import (
    Model as Model,
)
from .lens.lens_solve import (
    ViewFit as ViewFit,
)
from .lens.mrcal_wall import (
    solve_covariance as solve_covariance,
)
from .lens.rich_lens import (
    RATIONAL as RATIONAL,
)
from .lens.rich_lens import (
    RichLens as RichLens,
)
from .lens.rich_lens import (
    brown_over_picture as brown_over_picture,
)
from .plate.grid_camera import (
    camera_height as camera_height,
)
from .plate.grid_camera import (
    fit_grid_camera as fit_grid_camera,
)
from .plate.plate_camera import (
    CAMERA_NAMES as CAMERA_NAMES,
)
from .plate.plate_camera import (
    PlateCamera as PlateCamera,
)
from .plate.plate_camera import (
    Rays as Rays,
)
from .plate.plate_camera import (
    local_scale as local_scale,
)
from .plate.plate_fit import (
    CameraFit as CameraFit,
)
from .plate.stated_effects import (
    effects_of_statements as effects_of_statements,
)
