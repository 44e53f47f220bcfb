from .checks import (
    measurement_checks as measurement_checks,
)
from .report import (
    measurement_report as measurement_report,
)
from .report import (
    section_rows as section_rows,
)
from .run import (
    Measurement as Measurement,
)
from .run import (
    reconstruct as reconstruct,
)
