from .library import AuditResult as AuditResult
from .library import Calibration as Calibration
from .library import Surface as Surface
from .library import VerificationResult as VerificationResult
from .library import audit as audit
from .library import calibrate as calibrate
from .library import known as known
from .library import measure as measure
from .library import verify as verify
from .session import load_session as load_session
from .targets import load_target as load_target

__version__: str
