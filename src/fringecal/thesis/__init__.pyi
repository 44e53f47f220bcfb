from .analytic import (
    ANGLES_DEG as ANGLES_DEG,
)
from .analytic import (
    AnalyticCase as AnalyticCase,
)
from .analytic import (
    analytic_cases as analytic_cases,
)
from .counting import (
    count_fields as count_fields,
)
from .quadrants import (
    quadrant_phase as quadrant_phase,
)
