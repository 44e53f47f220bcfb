from .calibrating import (
    calibrate as calibrate,
)
from .calibration_value import (
    Calibration as Calibration,
)
from .known_values import (
    known as known,
)
from .surface_value import (
    Surface as Surface,
)
from .using import (
    audit as audit,
)
from .using import (
    measure as measure,
)
from .using import (
    verify as verify,
)
from .verdicts import (
    AuditResult as AuditResult,
)
from .verdicts import (
    VerificationResult as VerificationResult,
)
