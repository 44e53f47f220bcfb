from .run import (
    Page as Page,
)
from .run import (
    StepState as StepState,
)
from .run import (
    Walk as Walk,
)
from .run import (
    parse_page as parse_page,
)
from .run import (
    walk as walk,
)
