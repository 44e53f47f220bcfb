from .picture_series import (
    Series as Series,
)
from .picture_series import (
    series_of as series_of,
)
from .proposal import (
    Proposal as Proposal,
)
from .proposal import (
    Stated as Stated,
)
from .proposal import (
    decided as decided,
)
from .proposal import (
    looked_at as looked_at,
)
from .table_of_session import (
    captured_at as captured_at,
)
from .table_of_session import (
    session_table as session_table,
)
