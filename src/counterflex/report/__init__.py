"""One self-contained HTML page per job: what was machined, how far it was off, before and after."""

from counterflex.report.data import ErrorCurve, Fact, PredictionData, ReportData, ReportedDifference, VariantData
from counterflex.report.page import prediction_page, report_page, write_page

__all__ = [
    "ErrorCurve",
    "Fact",
    "PredictionData",
    "ReportData",
    "ReportedDifference",
    "VariantData",
    "prediction_page",
    "report_page",
    "write_page",
]
