"""Accuracy figures, defined once: path deviation, surface deviation, features, circularity, error budget, summary."""

from counterflex.evaluate.figures import Figures, weighted_figures
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation, path_figures

__all__ = ["Figures", "PathDeviation", "PathFigures", "path_deviation", "path_figures", "weighted_figures"]
