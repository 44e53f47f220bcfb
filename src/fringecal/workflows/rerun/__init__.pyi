from .run import (
    Rerun as Rerun,
)
from .run import (
    calibration_file as calibration_file,
)
from .run import (
    rerun as rerun,
)
from .run import (
    session_folder as session_folder,
)
