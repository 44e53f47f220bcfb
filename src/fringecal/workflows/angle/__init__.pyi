from .report import (
    angle_report as angle_report,
)
from .run import (
    ESTIMATORS as ESTIMATORS,
)
from .run import (
    break_angles as break_angles,
)
