from .coverage_summary import (
    StudySummary as StudySummary,
)
from .coverage_summary import (
    summarise as summarise,
)
from .report import (
    study_report as study_report,
)
from .run import (
    StudyPlan as StudyPlan,
)
from .run import (
    run_study as run_study,
)
from .workers import (
    ClusterKeys as ClusterKeys,
)
from .workers import (
    cluster as cluster,
)
from .workers import (
    local_pool as local_pool,
)
