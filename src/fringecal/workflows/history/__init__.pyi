from .report import (
    history_report as history_report,
)
from .report import (
    history_section as history_section,
)
from .report import (
    history_verdict as history_verdict,
)
from .report import (
    review_table as review_table,
)
