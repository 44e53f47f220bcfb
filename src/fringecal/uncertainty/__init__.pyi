from .budgets import (
    Budget as Budget,
)
from .budgets import (
    combined as combined,
)
from .components import (
    UncertaintyComponent as UncertaintyComponent,
)
from .components import (
    contributions as contributions,
)
from .conformity import (
    decide as decide,
)
from .coverage import (
    wilson_interval as wilson_interval,
)
from .degrees_of_freedom import (
    effective_dof as effective_dof,
)
from .detection_limit import (
    least_seen as least_seen,
)
from .detection_limit import (
    shift_seen as shift_seen,
)
from .estimates import (
    COVERAGE as COVERAGE,
)
from .estimates import (
    Estimate as Estimate,
)
from .estimates import (
    coverage_factor as coverage_factor,
)
from .influences import (
    Influence as Influence,
)
from .influences import (
    Source as Source,
)
from .known_bias import (
    uncertainty_with_bias as uncertainty_with_bias,
)
from .propagation import (
    propagate as propagate,
)
from .repeatability import (
    Line as Line,
)
from .repeatability import (
    fit_line as fit_line,
)
from .rounding import (
    dof_text as dof_text,
)
from .rounding import (
    uncertainty_text as uncertainty_text,
)
from .rounding import (
    value_text as value_text,
)
from .sampling.first_order import (
    FirstOrderCheck as FirstOrderCheck,
)
from .sampling.first_order import (
    check_first_order as check_first_order,
)
from .sampling.first_order import (
    draw_deviates as draw_deviates,
)
from .scores import (
    EN_DEFINITION as EN_DEFINITION,
)
from .scores import (
    EXPANDED_BY as EXPANDED_BY,
)
from .scores import (
    en_score as en_score,
)
from .systematic import (
    combined_map as combined_map,
)
from .systematic import (
    mean_uncertainty as mean_uncertainty,
)
