"""Features of inspected parts with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.feature_finding import Feature
from counterflex.evaluate.features import ZONES, FeatureRow, Machined, measure_features, uncovered
from counterflex.evaluate.inspection.scanned_part import ScannedPart
from counterflex.evaluate.inspection.sections import InspectedPart
from counterflex.evaluate.inspection.size_errors import ScaleEstimate
from counterflex.evaluate.measured_values import MeasurablePart
from counterflex.evaluate.prismatic.finding import PrismaticFeature, find_prismatic
from counterflex.evaluate.surface import NominalSurface

_DRAWS: Final = 24
_ONCE_MORE: Final = float(np.sqrt(2.0)) - 1.0  # Growth of the standard deviation of noise when it is drawn once more


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
    measure = partial(
        measure_features, surface, path, features, outline=first.nominal_outline, tolerances_m=tolerances_m
    )
    return with_uncertainty(measure, parts, scales, lambda part, _: part.place_sigma_m())


def with_uncertainty(
    measure: Callable[[dict[str, Any]], tuple[FeatureRow, ...]],
    parts: Mapping[str, Any],
    scales: Mapping[str, ScaleEstimate] | None,
    place_sigma_m: Callable[[Any, str], float],
) -> tuple[FeatureRow, ...]:
    """Rows of inspected parts with standard deviations, see :func:`inspected_features`.

    Args:
        measure: Gives the rows of parts by name.
        place_sigma_m: Standard deviation of one place of a feature of a part by noise alone, m.
    """
    rows = list(measure(dict(parts)))
    square = [{name: place_sigma_m(parts[name], row.feature) ** 2 for name in row.mean_m} for row in rows]
    for name, part in parts.items():
        for one in _changed(part, (scales or {}).get(name)):
            other = {_key(row): row.mean_m[name] for row in measure({name: one}) if name in row.mean_m}
            _add_change(rows, square, name, other)
    for name, part in parts.items():
        drawn = _drawn(part, measure)
        for j, row in enumerate(rows):
            if row.quantity in ZONES and name in row.worst_m:
                place = place_sigma_m(part, row.feature) ** 2
                rows[j], more_square = _without_noise(row, name, drawn.get(_key(row)), place)
                square[j][name] += more_square
    return tuple(
        replace(row, standard_deviation_m={name: float(np.sqrt(value)) for name, value in sums.items()})
        for row, sums in zip(rows, square, strict=True)
    )


def _key(row: FeatureRow) -> tuple[str, str]:
    return row.feature, row.quantity


def _changed(part: InspectedPart, scale: ScaleEstimate | None) -> list[InspectedPart]:
    """A part moved by each principal direction of its pose, and scaled, one standard deviation each."""
    values, vectors = np.linalg.eigh(part.registration.covariance)
    changed = [part.shifted(np.sqrt(values[k]) * vectors[:, k]) for k in np.flatnonzero(values > 0.0)]
    if scale is not None and scale.common and isinstance(part, ScannedPart):
        changed.append(part.scaled(float(np.hypot(scale.scale, scale.sigma))))
    return changed


def _add_change(
    rows: Sequence[FeatureRow], square: Sequence[dict[str, float]], name: str, other: Mapping[tuple[str, str], float]
) -> None:
    for row, sums in zip(rows, square, strict=True):
        if name in sums and _key(row) in other:
            sums[name] += (other[_key(row)] - row.mean_m[name]) ** 2


def _drawn(part: InspectedPart, measure: Callable[..., tuple[FeatureRow, ...]]) -> dict[tuple[str, str], Float]:
    """Values of features with the noise of a part drawn again."""
    draws = [part.redrawn(np.random.default_rng(seed)) for seed in range(_DRAWS)]
    more = {str(k): draw for k, draw in enumerate(draws) if draw is not None}
    return {_key(row): np.array(list(row.worst_m.values())) for row in (measure(more) if more else ())}


def _without_noise(row: FeatureRow, name: str, again: Float | None, place: float) -> tuple[FeatureRow, float]:
    """A zone extrapolated to no noise where it was drawn again, and what its variance grows by, m2."""
    if again is None or len(again) == 0:
        return row, place  # two extremes
    value = noiseless(row.worst_m[name], again)
    made = replace(row, worst_m={**row.worst_m, name: value}, mean_m={**row.mean_m, name: value})
    return made, float(np.var(again)) - place


def features_of_part(part: InspectedPart, candidates: Sequence[Feature]) -> tuple[Feature | PrismaticFeature, ...]:
    """Features of a part: grooves and round pockets by the moves of the tool, all else by the surface.

    Args:
        part: Inspected; its nominal part counts.
        candidates: Grooves and pockets that the moves may have made.
    """
    return features_shown(part.part.surface, part.p_part_tcp, candidates, part, part.nominal_outline)


def features_shown(
    surface: NominalSurface,
    p_part_tcp: Float,
    candidates: Sequence[Feature],
    part: Machined | MeasurablePart,
    outline: Float | None,
) -> tuple[Feature | PrismaticFeature, ...]:
    """Features of a part that can be measured, see :func:`features_of_part` and :func:`.measure_features`."""
    rows = measure_features(surface, p_part_tcp, candidates, {"part": part}, outline=outline)
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
