from .report import (
    certificate_report as certificate_report,
)
from .run import (
    certificate_of as certificate_of,
)
