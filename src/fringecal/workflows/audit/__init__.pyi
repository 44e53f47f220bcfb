from .record import (
    audit_record as audit_record,
)
from .report import (
    audit_report as audit_report,
)
from .run import (
    audit as audit,
)
from .sentences import (
    change_sentence as change_sentence,
)
from .sentences import (
    reuse_sentence as reuse_sentence,
)
