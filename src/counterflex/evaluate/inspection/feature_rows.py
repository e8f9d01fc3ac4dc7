"""Features of inspected parts with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.feature_finding import Feature
from counterflex.evaluate.features import ZONES, FeatureRow, measure_features, uncovered
from counterflex.evaluate.inspection.inspected_part import InspectedPart
from counterflex.evaluate.inspection.scanned_part import ScannedPart
from counterflex.evaluate.inspection.size_errors import ScaleEstimate
from counterflex.evaluate.prismatic.finding import PrismaticFeature, find_prismatic

_DRAWS: Final = 24
_ONCE_MORE: Final = float(np.sqrt(2.0)) - 1.0
"""Growth of the standard deviation of noise when it is drawn once more."""


def inspected_features(
    features: Sequence[Feature | PrismaticFeature],
    parts: Mapping[str, InspectedPart],
    tolerances_m: Mapping[tuple[str, str], float] | None = None,
    scales: Mapping[str, ScaleEstimate] | None = None,
) -> tuple[FeatureRow, ...]:
    """Measure features on inspected parts as on simulated ones, with the standard deviation of each value.

    It is the root of the sum of squares of three: the change of the mean value when the part is moved by each principal
    direction of the covariance of its pose, one standard deviation at a time; its change by the scale of the scan and
    the standard deviation of it, where two directions agree on one; and the noise of the measurement at one place of a
    feature.

    Flatness and roundness are distances of extremes, which noise drives apart: by as much again as it has, were there
    more of it. Where the noise of a part can be drawn again, they are extrapolated to none (:func:`noiseless`).

    Args:
        features: From :func:`~counterflex.evaluate.feature_finding.find_features`.
        parts: Name to part; all of one nominal part.
        tolerances_m: (feature, quantity) to +- tolerance, m; general tolerances for what is not listed.
        scales: Name to scale of its scan.
    """
    first = next(iter(parts.values()))
    surface, path = first.part.surface, first.p_part_tcp
    outline = first.nominal_outline
    rows = list(measure_features(surface, path, features, dict(parts), outline=outline, tolerances_m=tolerances_m))
    square = [{name: parts[name].place_sigma_m() ** 2 for name in row.mean_m} for row in rows]
    for name, part in parts.items():
        values, vectors = np.linalg.eigh(part.registration.covariance)
        changed = [part.shifted(np.sqrt(values[k]) * vectors[:, k]) for k in np.flatnonzero(values > 0.0)]
        scale = (scales or {}).get(name)
        if scale is not None and scale.common and isinstance(part, ScannedPart):
            changed.append(part.scaled(float(np.hypot(scale.scale, scale.sigma))))
        for one in changed:
            moved = measure_features(surface, path, features, {name: one}, outline=outline)
            other = {(row.feature, row.quantity): row.mean_m[name] for row in moved if name in row.mean_m}
            for row, sums in zip(rows, square, strict=True):
                if name in sums and (row.feature, row.quantity) in other:
                    sums[name] += (other[row.feature, row.quantity] - row.mean_m[name]) ** 2
    for name, part in parts.items():
        draws = [part.redrawn(np.random.default_rng(seed)) for seed in range(_DRAWS)]
        more = {str(k): draw for k, draw in enumerate(draws) if draw is not None}
        noisier = measure_features(surface, path, features, more, outline=outline) if more else ()
        drawn = {(row.feature, row.quantity): np.array(list(row.worst_m.values())) for row in noisier}
        for j, row in enumerate(rows):
            if row.quantity not in ZONES or name not in row.worst_m:
                continue
            again = drawn.get((row.feature, row.quantity))
            if again is None or len(again) == 0:
                square[j][name] += part.place_sigma_m() ** 2  # two extremes
                continue
            value = noiseless(row.worst_m[name], again)
            rows[j] = replace(row, worst_m={**row.worst_m, name: value}, mean_m={**row.mean_m, name: value})
            square[j][name] += float(np.var(again)) - part.place_sigma_m() ** 2
    return tuple(
        replace(row, standard_deviation_m={name: float(np.sqrt(value)) for name, value in sums.items()})
        for row, sums in zip(rows, square, strict=True)
    )


def features_of_part(part: InspectedPart, candidates: Sequence[Feature]) -> tuple[Feature | PrismaticFeature, ...]:
    """Features of a part: grooves and round pockets by the moves of the tool, all else by the surface.

    Args:
        part: Inspected; its nominal part counts.
        candidates: Grooves and pockets that the moves may have made.
    """
    surface = part.part.surface
    rows = measure_features(surface, part.p_part_tcp, candidates, {"part": part}, outline=part.nominal_outline)
    shown, walls, floors = uncovered(surface, candidates, rows)
    return (*shown, *find_prismatic(surface, walls, floors))


def noiseless(zone: float, noisier: Float) -> float:
    """A zone as it would be without the noise of measurement, from the same with noise drawn once more (k,).

    The zone of many independent places that are all alike grows as the standard deviation of their noise, which is
    sqrt(2) times as large with the second draw; that of a floor with form hardly grows. So

        z(s) = z(0) + c s,   z(0) = z(1) - (z(sqrt 2) - z(1)) / (sqrt 2 - 1)

    Source: Cook and Stefanski 1994, "Simulation-extrapolation estimation in parametric measurement error models".
    """
    grown = max(float(np.mean(noisier)) - zone, 0.0)
    return max(zone - grown / _ONCE_MORE, 0.0)
