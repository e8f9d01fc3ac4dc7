"""Accuracy figures, defined once: path deviation, surface deviation, features, circularity, error budget, summary."""

from counterflex.evaluate.figures import Figures, weighted_figures
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation, path_figures
from counterflex.evaluate.summary import SeedResult, Variant, check_summary, seed_rows, summary, table_rows
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation, nominal_surface, surface_deviation

__all__ = [
    "Figures",
    "NominalSurface",
    "PathDeviation",
    "PathFigures",
    "SeedResult",
    "SurfaceDeviation",
    "Variant",
    "check_summary",
    "nominal_surface",
    "path_deviation",
    "path_figures",
    "seed_rows",
    "summary",
    "surface_deviation",
    "table_rows",
    "weighted_figures",
]
