from .doubts_page import (
    judged_report as judged_report,
)
from .judging import (
    Judged as Judged,
)
from .judging import (
    judge_files as judge_files,
)
from .judging import (
    judge_points as judge_points,
)
from .judging import (
    judged_document as judged_document,
)
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
    board_pictures as board_pictures,
)
from .run import (
    known_lens as known_lens,
)
from .run import (
    measure_lens as measure_lens,
)
