from .conformity import (
    decide as decide,
)
from .coverage import (
    wilson_interval as wilson_interval,
)
from .estimates import (
    Estimate as Estimate,
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
    doubt_text as doubt_text,
)
from .rounding import (
    value_text as value_text,
)
from .systematic import (
    combined_map as combined_map,
)
from .systematic import (
    mean_uncertainty as mean_uncertainty,
)
