from .expected.form_orders import (
    FormPhase as FormPhase,
)
from .expected.form_orders import (
    orders_by_form as orders_by_form,
)
from .expected.form_search import (
    FoundForm as FoundForm,
)
from .expected.form_search import (
    demand_form as demand_form,
)
from .expected.form_search import (
    find_form as find_form,
)
from .expected.placed_form import (
    FormPlace as FormPlace,
)
from .forms.departures import (
    Departures as Departures,
)
from .forms.departures import (
    departures_of as departures_of,
)
from .forms.fitted_forms import (
    fit_plane as fit_plane,
)
from .forms.fitted_forms import (
    fit_sphere as fit_sphere,
)
from .forms.folds import (
    Fold as Fold,
)
from .forms.folds import (
    folds_of as folds_of,
)
from .forms.folds import (
    folds_table as folds_table,
)
from .forms.probes import (
    Probe as Probe,
)
from .forms.probes import (
    probe as probe,
)
from .forms.readings import (
    Reading as Reading,
)
from .forms.readings import (
    is_common as is_common,
)
from .forms.readings import (
    readings_table as readings_table,
)
from .forms.readings import (
    take_readings as take_readings,
)
from .forms.volume_probes import (
    volume_probe as volume_probe,
)
from .forms.volume_search import (
    PointPicture as PointPicture,
)
from .zigzag.filters import (
    FILTERS as FILTERS,
)
from .zigzag.filters import (
    FilterResult as FilterResult,
)
from .zigzag.filters import (
    filter_study as filter_study,
)
from .zigzag.filters import (
    filtered as filtered,
)
from .zigzag.filters import (
    models_table as models_table,
)
from .zigzag.filters import (
    ranking_table as ranking_table,
)
from .zigzag.height_errors import (
    ZigzagErrors as ZigzagErrors,
)
from .zigzag.height_errors import (
    zigzag_errors as zigzag_errors,
)
from .zigzag.pose import (
    ZigzagPose as ZigzagPose,
)
from .zigzag.profiles import (
    InCommon as InCommon,
)
from .zigzag.profiles import (
    ProfileCurve as ProfileCurve,
)
from .zigzag.profiles import (
    ProfileErrors as ProfileErrors,
)
from .zigzag.registration import (
    register_zigzag as register_zigzag,
)
from .zigzag.zigzag_shape import (
    zigzag_shape as zigzag_shape,
)
