from .captures import (
    CameraKnown as CameraKnown,
)
from .captures import (
    Capture as Capture,
)
from .captures import (
    ProjectorKnown as ProjectorKnown,
)
from .captures import (
    Session as Session,
)
from .check_document import (
    CaptureRow as CaptureRow,
)
from .check_document import (
    CheckReport as CheckReport,
)
from .check_document import (
    check_report as check_report,
)
from .check_document import (
    check_schema as check_schema,
)
from .checking import (
    SessionCheck as SessionCheck,
)
from .checking import (
    check_session as check_session,
)
from .checking import (
    load_session as load_session,
)
from .document import (
    FILE_NAME as FILE_NAME,
)
from .document import (
    SessionDocument as SessionDocument,
)
from .faults import (
    Fault as Fault,
)
from .faults import (
    PictureError as PictureError,
)
from .faults import (
    joined as joined,
)
from .fringes.fringe_axes import (
    FringeAxis as FringeAxis,
)
from .fringes.phase_maps import (
    StatedMap as StatedMap,
)
from .in_memory import (
    capture_of_arrays as capture_of_arrays,
)
from .in_memory import (
    session_of_captures as session_of_captures,
)
from .pictures.capture_files import (
    natural_key as natural_key,
)
from .pictures.picture import (
    Picture as Picture,
)
from .pictures.picture import (
    decode as decode,
)
from .pictures.picture import (
    to_grey as to_grey,
)
from .pictures.size_limits import (
    regular_bytes as regular_bytes,
)
from .temporary import (
    temporary_session as temporary_session,
)
from .toml_text import (
    to_toml as to_toml,
)
from .write import (
    write_session as write_session,
)
