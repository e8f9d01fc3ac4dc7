"""Accuracy figures, defined once: path deviation, surface deviation, features, circularity, error budget, summary."""
