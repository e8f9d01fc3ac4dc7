"""Features of inspected parts with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from counterflex.evaluate.feature_finding import Feature
from counterflex.evaluate.features import FeatureRow, measure_features
from counterflex.evaluate.inspection.inspected_part import InspectedPart


def inspected_features(features: Sequence[Feature], parts: Mapping[str, InspectedPart]) -> tuple[FeatureRow, ...]:
    """Measure features on inspected parts as on simulated ones, with the standard deviation of each value.

    It is the root of the sum of squares of two: the change of the mean value when the part is moved by each principal
    direction of the covariance of its pose, one standard deviation at a time; and the noise of the measurement at
    one place of a feature.

    Args:
        features: From :func:`~counterflex.evaluate.feature_finding.find_features`.
        parts: Name to part; all of one nominal part.
    """
    first = next(iter(parts.values()))
    surface, path = first.part.surface, first.p_part_tcp
    outline = first.nominal_outline
    rows = measure_features(surface, path, features, dict(parts), outline=outline)
    square = [{name: parts[name].place_sigma_m() ** 2 for name in row.mean_m} for row in rows]
    for name, part in parts.items():
        values, vectors = np.linalg.eigh(part.registration.covariance)
        for k in np.flatnonzero(values > 0.0):
            other_part = {name: part.shifted(np.sqrt(values[k]) * vectors[:, k])}
            moved = measure_features(surface, path, features, other_part, outline=outline)
            other = {(row.feature, row.quantity): row.mean_m[name] for row in moved if name in row.mean_m}
            for row, sums in zip(rows, square, strict=True):
                if name in sums and (row.feature, row.quantity) in other:
                    sums[name] += (other[row.feature, row.quantity] - row.mean_m[name]) ** 2
    return tuple(
        replace(row, standard_deviation_m={name: float(np.sqrt(value)) for name, value in sums.items()})
        for row, sums in zip(rows, square, strict=True)
    )
