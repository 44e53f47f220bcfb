from .report import (
    demonstration_report as demonstration_report,
)
from .run import (
    DemoTruth as DemoTruth,
    demonstrate as demonstrate,
    read_real as read_real,
    result_table as result_table,
)
