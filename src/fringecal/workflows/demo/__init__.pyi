from .compiled_ahead import (
    compile_ahead as compile_ahead,
)
from .report import (
    demonstration_report as demonstration_report,
)
from .run import (
    DemoTruth as DemoTruth,
)
from .run import (
    demonstrate as demonstrate,
)
from .run import (
    read_real as read_real,
)
from .run import (
    result_table as result_table,
)
