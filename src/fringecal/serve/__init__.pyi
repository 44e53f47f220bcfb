from .access import (
    LOOPBACK as LOOPBACK,
)
from .access import (
    SANDBOX as SANDBOX,
)
from .access import (
    guard as guard,
)
from .desk import (
    Desk as Desk,
)
from .runs import (
    Runs as Runs,
)
from .session_desk import (
    desk_pages as desk_pages,
)
from .uploads import (
    Bounds as Bounds,
)
from .waitress_server import (
    STRANGERS_BYTES as STRANGERS_BYTES,
)
from .waitress_server import (
    web_server as web_server,
)
