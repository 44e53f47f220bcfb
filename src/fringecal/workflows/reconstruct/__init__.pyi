from .capture_causes import (
    causes_of as causes_of,
)
from .checks import (
    measurement_causes as measurement_causes,
)
from .checks import (
    measurement_checks as measurement_checks,
)
from .report import (
    causes_in_words as causes_in_words,
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
from .volume_run import (
    VolumeMeasured as VolumeMeasured,
)
from .volume_run import (
    measure_volume as measure_volume,
)
from .volume_sections import (
    volume_report as volume_report,
)
from .volume_sections import (
    volume_shares as volume_shares,
)
