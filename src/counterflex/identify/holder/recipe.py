"""Recipe ``holder``: sensitivities of a strain-gauge spindle holder, and the force that it then tells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, saying, silent
from counterflex.core.units import DEG, KN, MICRO, MM, PERCENT
from counterflex.identify.data.alternative_readings import sign_mistakes, swapped_columns, unit_mistakes
from counterflex.identify.data.changes import Change, TableValues
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import check_reading, misfit_of
from counterflex.identify.data.model import CellModel
from counterflex.identify.holder import TITLE, residuals
from counterflex.identify.holder.estimators import cross_talk, hysteresis, regressions
from counterflex.identify.holder.proposal import LARGEST_N, SHORTER_M, holder_before, propose
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, cross_validate, fold_of_groups, score_separate
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.solve import solve
from counterflex.sensing.strain_holder import Gauge, StrainHolder, sight, tool_matrix

LEAST = 6
"""Loads needed, in at least three directions."""
DRIFT_S = 120.0
"""Length of a record from which a drift of the zeros is looked for."""
_TRUSTED = 0.3  # share of the sensitivities that a drawing is trusted to where readings of the data are compared
SPREAD_K = 1.0
"""Range of temperatures from which coefficients are looked for; less tells nothing but the thermometer's noise."""
SETTINGS: Mapping[str, float | int | str | bool] = {
    "drawing_share": residuals.DRAWING_SHARE,
    "drift": True,
    "temperature": True,
    "as_stated": False,
    "gauges": "given",
    "largest_n": LARGEST_N,
    "shorter_m": SHORTER_M,
}

CHECKING, FITTING, HELD_OUT, COMPARING = "checking the readings", "sensitivities", "held out", "estimators compared"
WORK = {CHECKING: 1.0, FITTING: 1.0, HELD_OUT: 5.0, COMPARING: 0.3}
"""Parts of the work with what they cost (share of processor time), as the progress tells them."""


def identify(inputs: Inputs) -> Identification:
    """Find the bridges' sensitivities to force and moment from known loads.

    ``inputs``: The holder before, whose drawing is what is known; datasets of the kind ``holder_loads``. Raises
    InputError: too few loads or directions, or data that fit far better when read otherwise. Raises FileFormatError: a
    channel is missing or not a number.
    """
    cell, data, holdout, s, progress = inputs
    parts = in_parts(progress, WORK)
    holder, blocks = prepared(cell, data, holdout)
    unseen = [residuals.readings(d, holder, reference_c=holder.reference_c) for d in holdout]
    _check_loads(blocks, ", ".join(d.where or d.name for d in data))
    remarks: list[str] = []
    for i, d in enumerate((*data, *holdout)):
        remarks += _check(d, holder, bool(s["as_stated"]))
        parts[CHECKING]((i + 1) / (len(data) + len(holdout)))
    free, fit = fitted(holder, blocks, s, saying(parts[FITTING], FITTING))
    parts[FITTING](1.0)
    held_out = _evaluate(free, blocks, unseen, len(holder.gauges), parts[HELD_OUT])
    parts[HELD_OUT](1.0)
    n = len(holder.gauges)
    identified = replace(
        holder,
        sensitivity=residuals.sensitivity_of(fit.values, n),
        bias=fit.values[6 * n : 7 * n],
        per_kelvin=fit.values[7 * n : 8 * n],
    )
    estimated = np.concatenate([b.estimated(fit.values) for b in blocks])
    figures, more = _figures(holder, identified, blocks, estimated)
    parts[COMPARING](1.0)
    mean, before = held_out.mean()
    worst, worst_before = held_out.largest()
    p95, p95_before = held_out.quantile(0.95)
    return Identification(
        recipe="holder",
        fits={"holder": fit},
        headline=(
            Figure("holdout_mean_n", "mean error of the force, loads not used", mean, before),
            Figure("holdout_p95_n", "force error, 95 % quantile, held-out loads", p95, p95_before),
            Figure("holdout_max_n", "largest error of the force, loads not used", worst, worst_before),
        ),
        figures=figures,
        changes=_changes(identified, direction_error(identified, fit, identified.p_holder_tcp)),
        remarks=(*remarks, *more, *_remarks(identified, fit, blocks)),
        pictures=(_picture(blocks, unseen, held_out),),
    )


def prepared(
    cell: CellModel, data: Sequence[Dataset], holdout: Sequence[Dataset] = ()
) -> tuple[StrainHolder, list[residuals.HolderReadings]]:
    """The holder as it is known before, at the mean temperature of the data, and their readings.

    Args:
        data: Kind ``holder_loads``.
        holdout: Likewise; its bridges have to sit where those of ``data`` do.

    Raises:
        InputError: The data do not agree on where the bridges sit.
    """
    holder = _at(_glued(holder_before(cell), (*data, *holdout)), data)
    return holder, [residuals.readings(d, holder, reference_c=holder.reference_c) for d in data]


def fitted(
    holder: StrainHolder,
    blocks: Sequence[residuals.HolderReadings],
    settings: Mapping[str, Any],
    progress: Progress = silent,
) -> tuple[Parameters, Fit]:
    """The parameters of a holder and their fit, its standard deviations with what all loads share.

    ``settings``: Others than :data:`SETTINGS`.
    """
    s = {**SETTINGS, **settings}
    spread_k = float(np.ptp(np.concatenate([b.warmer_k for b in blocks])))
    spread_s = max(float(np.ptp(b.time_s)) for b in blocks)
    free = residuals.parameters(
        holder,
        float(s["drawing_share"]),
        temperature=bool(s["temperature"]) and spread_k > SPREAD_K,
        drift=bool(s["drift"]) and spread_s > DRIFT_S,
    )
    return free, residuals.with_honest_sigma(solve(free, blocks, progress=progress), blocks)


def _glued(holder: StrainHolder, data: Sequence[Dataset]) -> StrainHolder:
    """The holder with its bridges where the data say they sit, by its drawing where that is elsewhere."""
    stated = [np.asarray(d.settings["gauges"], dtype=np.float64).reshape(-1) for d in data if "gauges" in d.settings]
    if not stated:
        return holder
    if any(len(g) % 5 or len(g) != len(stated[0]) or not np.allclose(g, stated[0]) for g in stated):
        raise InputError(
            "the data do not agree on where the bridges of the holder sit",
            where=", ".join(d.where or d.name for d in data),
            limit="setting gauges: five numbers for each bridge, the same in all data",
        )
    gauges = tuple(Gauge((r[0], r[1], r[2]), r[3], r[4]) for r in stated[0].reshape(-1, 5).tolist())
    now = np.array([(*g.p_holder_gauge, g.angle_rad, g.factor) for g in holder.gauges])
    if len(gauges) == len(now) and np.allclose(now.reshape(-1), stated[0], atol=1e-5):
        return holder
    return StrainHolder.designed(holder.beam, gauges, holder.p_holder_tcp, float(holder.noise.mean()), holder.segment)


def _at(holder: StrainHolder, data: Sequence[Dataset]) -> StrainHolder:
    """The holder with its zeros carried to the mean temperature of the data, where they are best known."""
    warm = [d.values("temperature_c")[:, 0] for d in data if d.has("temperature_c") and len(d)]
    if not warm:
        return holder
    reference_c = round(float(np.mean(np.concatenate(warm))), 1)
    bias = holder.bias + (reference_c - holder.reference_c) * holder.per_kelvin
    return replace(holder, bias=bias, reference_c=reference_c)


def _check_loads(blocks: Sequence[residuals.HolderReadings], where: str) -> None:
    force = np.concatenate([b.force for b in blocks])
    size = np.linalg.norm(force, axis=1)
    loaded = force[size > 0.05 * max(float(size.max(initial=0.0)), 1e-9)]
    if len(loaded) < LEAST:
        raise InputError("too few loads on the holder", where=where, value=len(loaded), limit=f">= {LEAST}")
    spread = np.linalg.svd(loaded, compute_uv=False)
    if spread[2] < 0.02 * spread[0]:
        weak = np.linalg.svd(loaded)[2][2]
        raise InputError(
            "the loads on the holder lie in one plane, so one force direction is not determined",
            where=where,
            value=f"nothing along {np.round(weak, 2).tolist()}",
            hint="Press along x, y and z at least",
        )


def _check(data: Dataset, holder: StrainHolder, as_stated: bool) -> tuple[str, ...]:
    free = residuals.parameters(holder, _TRUSTED, temperature=False, drift=False)
    alternatives = [
        *unit_mistakes(data, "f_tcp_holder"),
        *sign_mistakes(data, "f_tcp_holder"),
        *swapped_columns(data, "f_tcp_holder"),
        *swapped_columns(data, "strain"),
        *sign_mistakes(data, "strain"),
    ]
    return check_reading(
        data,
        alternatives,
        lambda one: misfit_of(solve(free, [residuals.readings(one, holder, reference_c=holder.reference_c)])),
        as_stated=as_stated,
    )


def _evaluate(
    free: Parameters,
    blocks: Sequence[residuals.HolderReadings],
    unseen: Sequence[residuals.HolderReadings],
    n: int,
    progress: Progress,
) -> HeldOut:
    zeros = [name for name in residuals.needed(n) if free.items[free.index(name)].free]
    if unseen:
        local = [f"bridge{i + 1}.zero" for i in range(n)]
        return score_separate(free, blocks, unseen, needed=zeros, local=local, error=_force_error, progress=progress)
    return cross_validate(free, blocks, needed=zeros, error=_force_error, progress=progress)


def _force_error(block: Any, x: Float) -> Float:
    return residuals.force_error(block, x)


def _figures(
    holder: StrainHolder, identified: StrainHolder, blocks: Sequence[residuals.HolderReadings], estimated: Float
) -> tuple[tuple[Figure, ...], list[str]]:
    noise = np.diag(identified.noise**2)
    seen = sight(tool_matrix(identified.sensitivity, identified.p_holder_tcp), noise)
    drawn = sight(tool_matrix(holder.sensitivity, holder.p_holder_tcp), noise)
    figures = [Figure("condition", "condition of strain by force, weighted by noise", seen.condition, drawn.condition)]
    figures += [
        Figure(f"sample_sigma_{a}_n", f"standard deviation of one sample's force along {a}", float(v), float(w))
        for a, v, w in zip("xyz", seen.sigma_n, drawn.sigma_n, strict=True)
    ]
    block = blocks[0]
    folds = fold_of_groups([block.group])[0]
    for name, error in regressions(block, folds).items():
        length = np.linalg.norm(error, axis=1)
        if np.any(np.isfinite(length)):
            text = f"mean error of {name} regression of force on strain, loads not used"
            figures.append(Figure(f"holdout_{name}_n", text, float(np.nanmean(length))))
    error = estimated[: len(block.force)] - block.force
    for a, share in zip("xyz", cross_talk(block, error), strict=True):
        if np.isfinite(share):
            figures.append(Figure(f"cross_talk_{a}_share", f"force shown across a load along {a}, share", float(share)))
    stays = hysteresis(block, estimated[: len(block.force)])
    more = []
    if np.isfinite(stays):
        figures.append(Figure("hysteresis_share", "remaining share of a removed load (hysteresis)", stays))
        if abs(stays) > 0.01:
            more.append(f"{100 * stays:.1f} % of a load remains after its removal: check screws and glue of the holder")
    weak = seen.directions[2]
    more.append(
        f"Best determined: a force along {np.round(seen.directions[0], 2).tolist()} "
        f"({seen.direction_sigma_n[0]:.1f} N for "
        f"one sample); worst: along {np.round(weak, 2).tolist()} ({seen.direction_sigma_n[2]:.1f} N)"
    )
    return tuple(figures), more


def _remarks(identified: StrainHolder, fit: Fit, blocks: Sequence[residuals.HolderReadings]) -> tuple[str, ...]:
    points = np.unique(np.round(np.concatenate([b.p_holder_load for b in blocks]), 3), axis=0)
    moved = identified.p_holder_tcp + np.array([0.0, 0.0, 50.0 * MM])
    K = tool_matrix(identified.sensitivity, moved)
    worst = float(np.linalg.norm(direction_error(identified, fit, moved), axis=0).max())
    out = [
        "For a tool 50 mm longer the matrix follows from the lever: expected error "
        f"{100 * worst:.1f} % of the force"
        + (
            ""
            if len(points) > 1
            else "; all loads acted at one point, so this depends on the drawing. Load at a second point to "
            "determine it"
        )
    ]
    if np.linalg.cond(K) > 30.0:
        out.append(
            "One direction of force is poorly determined; propose with gauges = choose selects better "
            "positions of the bridges"
        )
    return tuple(out)


def direction_error(identified: StrainHolder, fit: Fit, p_holder_tcp: Float) -> Float:
    """Uncertainty of a force after the calibration, by direction: cross-talk off the diagonal.

    ``var f_i = sum over bridges of (M dS [e_j; p x e_j])_i`` for a force of 1 N along j.

    ``p_holder_tcp``: (3,) m tool tip. Returns (3, 3) standard deviation of the force shown along i (rows) by a force of
    1 N along j (columns).
    """
    n = len(identified.gauges)
    rows = [int(np.flatnonzero(fit.free_index == k)[0]) for k in range(6 * n)]
    covariance = fit.covariance[np.ix_(rows, rows)]  # of the free parameters, in fit coordinates
    slope, M = fit.parameters.slope(fit.values)[: 6 * n], identified.matrix(p_holder_tcp)
    out = np.zeros((3, 3))
    for j, e in enumerate(np.eye(3)):
        load = np.concatenate([e, np.cross(p_holder_tcp, e)])
        map_ = np.einsum("ai,k->aik", M, load).reshape(3, 6 * n) * slope
        out[:, j] = np.sqrt(np.diag(map_ @ covariance @ map_.T))
    return out


def _changes(identified: StrainHolder, error: Float) -> tuple[Change, ...]:
    gauges = [
        {
            "x_mm": round(g.p_holder_gauge[0] / MM, 4),
            "y_mm": round(g.p_holder_gauge[1] / MM, 4),
            "z_mm": round(g.p_holder_gauge[2] / MM, 4),
            "angle_deg": round(g.angle_rad / DEG, 4),
            "factor": g.factor,
        }
        for g in identified.gauges
    ]
    values: dict[str, Any] = {
        "gauges": gauges,
        "sensitivity_um_m_per_kn": [_rounded(r, MICRO / KN) for r in identified.sensitivity],
        "bias_um_m": _rounded(identified.bias, MICRO),
        "temperature_um_m_per_k": _rounded(identified.per_kelvin, MICRO),
        "reference_c": identified.reference_c,
        "error_percent": [_rounded(r, PERCENT) for r in error],
    }
    return (TableValues("holder", values),)


def _rounded(values: Float, unit: float) -> list[float]:
    return [float(f"{v / unit:.6g}") for v in values]


def _picture(
    blocks: Sequence[residuals.HolderReadings], unseen: Sequence[residuals.HolderReadings], held_out: HeldOut
) -> Picture:
    of = unseen or blocks
    size = [np.linalg.norm(b.force, axis=1) for b in of]
    x = np.array([size[b][r] for b, r in zip(held_out.block, held_out.row, strict=True)])
    return Picture(
        "Error of the force from the bridges, held-out loads",
        "load, N",
        "error, N",
        (Curve("drawing", x, held_out.nominal), Curve("identified", x, held_out.identified)),
    )


RECIPE = Recipe(name="holder", title=TITLE, kinds=("holder_loads",), settings=SETTINGS, find=identify, propose=propose)
