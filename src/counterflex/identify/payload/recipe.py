"""Recipe ``payload``: zero, weight, centre of gravity, mounting, drift and hose pack of the flange sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import in_parts, share_of
from counterflex.core.units import DEG, MINUTE, MM
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import BodyMass, Change, TableValues
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.payload import TITLE
from counterflex.identify.payload import checks as payload_checks
from counterflex.identify.payload import weight as payload_weight
from counterflex.identify.payload.data import KINDS, check_orientations, clock, readings, shared_mass, with_added_mass
from counterflex.identify.payload.groups import ALIKE_RAD, count_of, groups_of
from counterflex.identify.payload.holdout import held_out_forces, held_out_moments
from counterflex.identify.payload.hose_pack import (
    BASE,
    ROWS_PER_FUNCTION,
    Rest,
    choose_rest,
    degrees_of,
    frames_of,
    trials_of,
)
from counterflex.identify.payload.parameters import (
    DRIFT,
    INERTIA,
    KELVIN,
    TURN,
    Effects,
    Knowledge,
    needed,
    parameters,
    seg_frame_com,
    sensor_of,
)
from counterflex.identify.payload.proposal import FORCE_N, HEIGHT_M, MOMENT_NM, NEAR_SHARE, propose
from counterflex.identify.payload.residuals import SensorReadings, force_error
from counterflex.identify.payload.sensor import sensor_before
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut, score_separate
from counterflex.identify.solver.jackknife import parts_of_groups, with_groups_once, with_jackknife
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.sensing.carrier import hose_bodies
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.orientation_basis import COUNTS

SIGNIFICANT = 2.6
"""Standard deviations beyond which a drift is kept: one of six components exceeds that by chance in 6 % of cases."""
_HOUR = 60.0 * MINUTE
_ROUNDS = 2
CHECKING, WEIGHT, HOSE, HELD_OUT = "checking the data", "weight and zero", "hose pack", "held-out orientations"
SETTINGS: Mapping[str, float | int | str | bool] = {
    "hose": "auto",
    "hose_from": "auto",
    "drift": True,
    "temperature": True,
    "inertia": True,
    "window_s": 0.1,
    "mounting_rad": 2.0 * DEG,
    "offset_n": 3.0,
    "offset_nm": 1.0,
    "as_stated": False,
    "height_m": HEIGHT_M,
    "near_share": NEAR_SHARE,
    "force_n": FORCE_N,
    "moment_nm": MOMENT_NM,
}


def identify(inputs: Inputs) -> Identification:
    """Find the constants of the flange sensor from readings without a process.

    ``inputs``: The sensor before; ``sensor_poses`` and ``sensor_motion``. Setting ``hose`` is ``auto``, ``none``, ``1``
    or ``2`` (degree of its functions), ``hose_from`` ``auto``, ``base`` or the body that the hose pack comes from.

    Raises:
        InputError: Too few orientations, or data that fit far better when read otherwise.
        FileFormatError: A channel is missing or not a number.
    """
    cell, data, holdout, s, progress = inputs
    sensor = sensor_before(cell)
    start_s, reference_c = clock(data, sensor.reference_c)
    window_s = float(s["window_s"])

    def block_of(d: Dataset, chain: ElasticChain, hose_from: str = "") -> SensorReadings:
        framed = replace(sensor, hose_from=hose_from)
        return readings(d, chain, framed, reference_c=reference_c, start_s=start_s, window_s=window_s)

    chain = cell.chain
    blocks = [block_of(d, chain) for d in data]
    groups = groups_of(blocks, [d.kind != "sensor_motion" for d in data])

    def blocks_in(hose_from: str = "") -> list[SensorReadings]:
        return [replace(block_of(d, chain, hose_from), group=g) for d, g in zip(data, groups, strict=True)]

    blocks = blocks_in()
    degrees = degrees_of(s)
    bodies = hose_bodies(chain, sensor.segment)
    frames = frames_of(s, bodies, with_joints=all(d.has("q") for d in (*data, *holdout)))
    trials = trials_of(blocks, degrees, frames, forced=str(s["hose"]) != "auto")
    parts = in_parts(progress, _work(trials))
    remarks = list(check_orientations(blocks, ", ".join(d.where or d.name for d in data)))
    for i, d in enumerate((*data, *holdout)):
        remarks += payload_weight.check(d, lambda x: block_of(x, chain), as_stated=bool(s["as_stated"]))
        remarks += payload_checks.check(d, sensor, lambda x: block_of(x, chain), as_stated=bool(s["as_stated"]))
        parts[CHECKING]((i + 1) / (len(data) + len(holdout)))
    before = _at(sensor, reference_c)
    known = replace(
        Knowledge(),
        turn_rad=float(s["mounting_rad"]),
        offset_n=float(s["offset_n"]),
        offset_nm=float(s["offset_nm"]),
    )
    effects = _effects(blocks, s)
    shares = [share_of(parts[WEIGHT], i / (_ROUNDS + 1), (i + 1) / (_ROUNDS + 1), WEIGHT) for i in range(_ROUNDS + 1)]
    fit = solve(parameters(before, known, effects), blocks, progress=shares[0])
    for i in range(_ROUNDS):  # a heavier tool bends the arm more, which turns the sensor
        chain = with_added_mass(chain, sensor.segment, float(fit.values[6]), seg_frame_com(sensor, fit))
        blocks = blocks_in()
        fit = solve(parameters(before, known, effects), blocks, progress=shares[i + 1])
    parts[WEIGHT](1.0)
    effects = _significant(fit, effects)
    rest = choose_rest(
        blocks_in,
        before,
        known,
        effects,
        degrees,
        frames,
        parts[HOSE],
        forced=str(s["hose"]) != "auto",
    )
    parts[HOSE](1.0)
    effects = replace(effects, degree=rest.degree)
    chosen = parameters(before, known, effects)
    blocks = blocks_in(rest.hose_from)
    fit = solve(chosen, blocks)
    fit = with_jackknife(with_groups_once(fit, blocks), blocks, parts_of_groups(blocks))
    remarks += payload_weight.check_rest(blocks, fit, as_stated=bool(s["as_stated"]))
    unseen = [block_of(d, chain, rest.hose_from) for d in holdout]
    if unseen:
        force = score_separate(
            chosen, blocks, unseen, needed=needed(), error=force_error, progress=share_of(parts[HELD_OUT], 0.2, 0.6)
        )
    else:
        force = rest.candidates[rest.key] if rest.key in rest.candidates else held_out_forces(chosen, blocks)
    moment = held_out_moments(force, chosen, blocks, unseen, share_of(parts[HELD_OUT], 0.6, 1.0))
    parts[HELD_OUT](1.0)
    identified = sensor_of(replace(sensor, hose_from=rest.hose_from), fit.values, reference_c)
    remarks += _remarks(cell, identified, fit, effects, rest, blocks)
    return Identification(
        recipe="payload",
        fits={"payload": fit},
        headline=_headline(force, moment),
        figures=_figures(force, moment, fit, identified),
        changes=_changes(cell, identified, effects),
        remarks=tuple(remarks),
        pictures=_pictures(unseen or blocks, force, moment),
    )


def _work(trials: Mapping[str, float]) -> dict[str, float]:
    """Parts with what they cost, in fits of the plain weight (processor time, ``tools/measure_progress.py``)."""
    hose = sum(trials.values())
    return {CHECKING: 5.0, WEIGHT: 0.5, HOSE: hose, HELD_OUT: 1.0 + 0.15 * max(trials.values(), default=1.0)}


def _at(sensor: FlangeSensor, reference_c: float) -> FlangeSensor:
    """The sensor with its bias carried to another reference temperature."""
    warmer = reference_c - sensor.reference_c
    return replace(sensor, w_bias=sensor.w_bias + warmer * sensor.w_kelvin, reference_c=reference_c)


def _effects(blocks: Sequence[SensorReadings], s: Mapping[str, Any]) -> Effects:
    time_s = np.concatenate([b.time_s for b in blocks])
    warm = np.concatenate([b.warmer_k for b in blocks])
    moving = any(np.any(b.alpha != 0.0) for b in blocks)
    return Effects(
        drift=bool(s["drift"]) and float(np.ptp(time_s)) > 60.0,
        temperature=bool(s["temperature"]) and float(np.ptp(warm)) > 0.5,
        inertia=bool(s["inertia"]) and moving,
    )


def _significant(fit: Fit, effects: Effects) -> Effects:
    """Drift and temperature only where a component stands out of its noise."""

    def is_significant(part: slice) -> bool:
        return bool(np.any(np.abs(fit.values[part] - fit.parameters.nominal[part]) > SIGNIFICANT * fit.sigma[part]))

    return replace(
        effects,
        drift=effects.drift and is_significant(DRIFT),
        temperature=effects.temperature and is_significant(KELVIN),
    )


def _headline(force: HeldOut, moment: HeldOut) -> tuple[Figure, ...]:
    out = []
    for held_out, key, text in ((force, "n", "force"), (moment, "nm", "moment")):
        (mean, before), (worst, worst_before) = held_out.mean(), held_out.largest()
        out += [
            Figure(
                f"holdout_mean_{key}", f"mean error of the {text} without process, held-out orientations", mean, before
            ),
            Figure(f"holdout_max_{key}", f"largest error of the {text}, held-out orientations", worst, worst_before),
        ]
    return tuple(out)


def _figures(force: HeldOut, moment: HeldOut, fit: Fit, identified: FlangeSensor) -> tuple[Figure, ...]:
    turn = float(np.linalg.norm(fit.values[TURN]))
    return (
        Figure("holdout_p95_n", "force error, 95 % quantile, held-out orientations", *force.quantile(0.95)),
        Figure("holdout_p95_nm", "moment error, 95 % quantile, held-out orientations", *moment.quantile(0.95)),
        Figure("mass_kg", "mass behind the sensor", identified.mass_kg, float(fit.parameters.nominal[6])),
        Figure("mass_sigma_kg", "its standard deviation", fit.sigma_of("mass")),
        Figure("mounting_deg", "rotation of the sensor against the cell file", turn / DEG, 0.0),
        Figure("offset_degree", "degree of the hose terms", float(identified.degree), 0.0),
    )


def _changes(cell: CellModel, identified: FlangeSensor, effects: Effects) -> tuple[Change, ...]:
    changes: list[Change] = [TableValues("sensor", _table(identified, effects))]
    chain = cell.chain
    split = shared_mass(chain, identified.segment, identified.mass_kg, _seg_com(identified))
    changes += [BodyMass(chain.names[i], kg, com) for i, (kg, com) in split.items()]
    return tuple(changes)


def _seg_com(identified: FlangeSensor) -> Float:
    out: Float = pose.transform(identified.T_seg_sensor, identified.p_sensor_com)
    return out


def _table(identified: FlangeSensor, effects: Effects) -> dict[str, Any]:
    """The table of the cell file, in its units."""
    a, b, c = rotation.to_zyx(identified.T_seg_sensor[:3, :3]) / DEG
    x, y, z = identified.T_seg_sensor[:3, 3] / MM

    def row(values: Float) -> list[float]:
        return [float(f"{v:.6g}") for v in values]

    table: dict[str, Any] = {
        "segment": identified.segment,
        **dict(
            zip(("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"), row(np.array([x, y, z, a, b, c])), strict=True)
        ),
        "mass_kg": float(f"{identified.mass_kg:.6g}"),
        "com_mm": row(identified.p_sensor_com / MM),
        "bias_n": row(identified.w_bias[:3]),
        "bias_nm": row(identified.w_bias[3:]),
        "reference_c": identified.reference_c,
        "offset": [row(r) for r in identified.w_offset],
        "hose_from": identified.hose_from,
    }
    if effects.drift:
        table["drift_n_per_h"], table["drift_nm_per_h"] = (
            row(identified.w_drift_per_s[:3] * _HOUR),
            row(identified.w_drift_per_s[3:] * _HOUR),
        )
    if effects.temperature:
        table["temperature_n_per_k"], table["temperature_nm_per_k"] = (
            row(identified.w_kelvin[:3]),
            row(identified.w_kelvin[3:]),
        )
    if effects.inertia:
        table["inertia_kg_m2"] = row(identified.inertia_kg_m2)
    return table


def _remarks(
    cell: CellModel, identified: FlangeSensor, fit: Fit, effects: Effects, rest: Rest, blocks: Sequence[SensorReadings]
) -> list[str]:
    out = []
    rows, count = sum(len(b.group) for b in blocks), count_of(blocks)
    if count < rows and not effects.inertia:
        out.append(
            f"{rows} readings in {count} different orientations: readings of one orientation count together, in the "
            "standard deviations and in the folds"
        )
    chain = cell.chain
    split = shared_mass(chain, identified.segment, identified.mass_kg, _seg_com(identified))
    if split:
        names = ", ".join(chain.names[i] for i in split)
        out.append(
            f"The sensor measures the total mass behind it, {identified.mass_kg:.2f} kg; its distribution among the "
            f"bodies is not determined. The difference from the cell file is assigned to {names}"
        )
    else:
        out.append("The cell file has no body with mass behind the sensor, so only the table [sensor] is changed")
    if len(rest.candidates) > 1:
        listed = ", ".join(
            f"degree {degree} in {body}: {held_out.mean()[0]:.2f} N" if degree else f"none: {held_out.mean()[0]:.2f} N"
            for (body, degree), held_out in rest.candidates.items()
        )
        reason = (
            f"degree {identified.degree} is used, with the rotation of the sensor in {identified.hose_from or BASE}"
            if identified.degree
            else "none is used, as none improves held-out orientations"
        )
        out.append(f"Hose terms, error on held-out orientations: {listed}; {reason}")
        out += [
            f"The hose terms of degree {degree} in {body} were not used: they would make the standard deviation of "
            f"the mass "
            f"{cost:.0f} times larger"
            for (body, degree), cost in rest.dear.items()
        ]
    elif identified.degree == 0 and not effects.inertia:
        out.append(
            f"No hose terms were fitted; they need {ROWS_PER_FUNCTION * COUNTS[1]} or more different orientations; "
            "the data have "
            f"{count_of(blocks)} (directions of gravity that differ by over {ALIKE_RAD / DEG:.0f} deg; repeats and "
            "copies do not count)"
        )
    if identified.degree:
        out.append(
            "A hose force that rotates with gravity cannot be separated from weight; the standard deviations of "
            "mass and mounting include this"
        )
    if effects.drift and effects.temperature:
        i, j = fit.parameters.index("drift.fz"), fit.parameters.index("temperature.fz")
        place = {int(k): n for n, k in enumerate(fit.free_index)}
        cov = fit.covariance[np.ix_([place[i], place[j]], [place[i], place[j]])]
        share = float(cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1]))
        if abs(share) > 0.9:
            out.append(
                f"Temperature rose with time (correlation of their effects {share:.2f}): drift and temperature "
                "coefficients cannot be separated. Read the sensor again after it has cooled"
            )
    if np.all(identified.inertia_kg_m2 == 0.0):
        out.append("The inertia is not determined; record a motion (kind sensor_motion) to identify it")
    if effects.inertia and not np.all(np.linalg.eigvalsh(_tensor(fit.values[INERTIA])) > 0.0):
        out.append("The identified inertia is not that of a rigid body; the motion does not determine it")
    return out


def _tensor(values: Float) -> Float:
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _pictures(blocks: Sequence[SensorReadings], force: HeldOut, moment: HeldOut) -> tuple[Picture, ...]:
    tilt = [np.degrees(np.arccos(np.clip(-b.R_base_sensor[:, 2, 2], -1.0, 1.0))) for b in blocks]
    x = np.array([tilt[b][r] for b, r in zip(force.block, force.row, strict=True)])
    out = []
    for held_out, unit, text in ((force, "N", "Force"), (moment, "N m", "Moment")):
        curves = (Curve("before", x, held_out.nominal), Curve("identified", x, held_out.identified))
        out.append(
            Picture(
                f"{text} without process, held-out orientations",
                "angle between the sensor's z axis and down, deg",
                f"error, {unit}",
                curves,
            )
        )
    return tuple(out)


RECIPE = Recipe(
    name="payload",
    title=TITLE,
    kinds=KINDS,
    settings=SETTINGS,
    find=identify,
    propose=propose,
)
