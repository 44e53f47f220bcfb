from .report import (
    comparison_report as comparison_report,
)
