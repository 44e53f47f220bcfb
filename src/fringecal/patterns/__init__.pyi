from .code_frames import (
    gray_frames as gray_frames,
)
from .code_frames import (
    stripe_numbers as stripe_numbers,
)
from .frame_drawing import (
    Axis as Axis,
)
from .frame_drawing import (
    Raster as Raster,
)
from .frame_drawing import (
    flat_frame as flat_frame,
)
from .frame_drawing import (
    fringe_frame as fringe_frame,
)
from .pattern_charts import (
    alignment_chart as alignment_chart,
)
from .pattern_charts import (
    focus_chart as focus_chart,
)
from .period_choice import (
    PeriodChoice as PeriodChoice,
)
from .period_choice import (
    choose_periods as choose_periods,
)
from .period_choice import (
    order_error_rate as order_error_rate,
)
from .period_choice import (
    phase_noise_rad as phase_noise_rad,
)
from .png_bytes import (
    png_of as png_of,
)
from .projector_response import (
    Response as Response,
)
from .projector_response import (
    gamma_response as gamma_response,
)
from .projector_response import (
    measured_response as measured_response,
)
from .ripple import (
    Ripple as Ripple,
)
from .ripple import (
    drawn_ripple as drawn_ripple,
)
from .set_layout import (
    Code as Code,
)
from .set_layout import (
    Pattern as Pattern,
)
from .set_layout import (
    PatternSet as PatternSet,
)
from .set_layout import (
    pattern_set as pattern_set,
)
from .set_layout import (
    patterns_document as patterns_document,
)
