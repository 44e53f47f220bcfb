from .record import (
    lens_record as lens_record,
)
from .report import (
    lens_report as lens_report,
)
from .report import (
    lens_section as lens_section,
)
from .run import (
    known_lens as known_lens,
)
from .run import (
    measure_lens as measure_lens,
)
