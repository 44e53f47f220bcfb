from .charts import (
    Chart as Chart,
)
from .drift import (
    LEAST_POINTS as LEAST_POINTS,
)
from .drift import (
    YEAR_DAYS as YEAR_DAYS,
)
from .due import (
    rate_text as rate_text,
)
from .entries import (
    Reading as Reading,
)
from .entries import (
    en_of as en_of,
)
from .entries import (
    read_entry as read_entry,
)
from .exchange import (
    export_table as export_table,
)
from .exchange import (
    import_table as import_table,
)
from .gauge import (
    anova_study as anova_study,
)
from .gauge import (
    range_study as range_study,
)
from .review import (
    Review as Review,
)
from .review import (
    Series as Series,
)
from .review import (
    repeats_of as repeats_of,
)
from .review import (
    reviews_of as reviews_of,
)
from .run_lengths import (
    cusum_run_length as cusum_run_length,
)
from .run_lengths import (
    ewma_run_length as ewma_run_length,
)
from .run_lengths import (
    shewhart_run_length as shewhart_run_length,
)
from .standing import (
    Standing as Standing,
)
from .standing import (
    due_date as due_date,
)
from .standing import (
    last_text as last_text,
)
from .standing import (
    standing_of as standing_of,
)
from .standing import (
    standing_sentences as standing_sentences,
)
from .store import (
    open_history as open_history,
)
from .store import (
    readings_of as readings_of,
)
from .table_cells import (
    captured_since as captured_since,
)
from .table_cells import (
    parsed_time as parsed_time,
)
from .type_one import (
    type_one_study as type_one_study,
)
