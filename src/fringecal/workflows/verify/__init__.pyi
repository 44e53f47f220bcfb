from .artefacts import (
    ArtefactVerification as ArtefactVerification,
)
from .artefacts import (
    verify_artefact as verify_artefact,
)
from .checks import (
    artefact_checks as artefact_checks,
)
from .checks import (
    verification_checks as verification_checks,
)
from .checks import (
    verified_checks as verified_checks,
)
from .record import (
    verification_record as verification_record,
)
from .record_artefact import (
    artefact_record as artefact_record,
)
from .report import (
    errors_section as errors_section,
)
from .report import (
    profiles_section as profiles_section,
)
from .report import (
    surface_section as surface_section,
)
from .report import (
    verification_report as verification_report,
)
from .report_artefact import (
    artefact_report as artefact_report,
)
from .report_artefact import (
    artefact_surface_section as artefact_surface_section,
)
from .report_artefact import (
    numbers_section as numbers_section,
)
from .run import (
    VERIFIED as VERIFIED,
)
from .run import (
    Verification as Verification,
)
from .run import (
    artefact_capture as artefact_capture,
)
from .run import (
    studied as studied,
)
from .run import (
    verify as verify,
)
from .session_artefacts import (
    Verified as Verified,
)
from .session_artefacts import (
    independent as independent,
)
from .session_artefacts import (
    verify_capture as verify_capture,
)
from .session_artefacts import (
    verify_session as verify_session,
)
from .volume_artefacts import (
    VolumeVerification as VolumeVerification,
)
from .volume_artefacts import (
    judged_in_volume as judged_in_volume,
)
from .volume_artefacts import (
    verify_in_volume as verify_in_volume,
)
from .volume_report import (
    volume_verification_report as volume_verification_report,
)
