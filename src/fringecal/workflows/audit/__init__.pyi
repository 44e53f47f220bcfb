from .checks import (
    audit_checks as audit_checks,
)
from .checks import (
    changes_of as changes_of,
)
from .consequences import (
    consequence_sentence as consequence_sentence,
)
from .record import (
    audit_record as audit_record,
)
from .report import (
    audit_report as audit_report,
)
from .run import (
    Audit as Audit,
)
from .run import (
    audit as audit,
)
from .sentences import (
    audit_sentence as audit_sentence,
)
from .sentences import (
    change_sentence as change_sentence,
)
from .sentences import (
    reuse_sentence as reuse_sentence,
)
