"""One self-contained HTML page per job: what was machined, how far it was off, before and after."""

from counterflex.report.data import Curve, Difference, Fact, PredictionData, ReportData, VariantData
from counterflex.report.page import prediction_page, report_page, write_page

__all__ = [
    "Curve",
    "Difference",
    "Fact",
    "PredictionData",
    "ReportData",
    "VariantData",
    "prediction_page",
    "report_page",
    "write_page",
]
