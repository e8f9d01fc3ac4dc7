"""Recipe ``payload``: zero, weight, centre of gravity, mounting, drift and hose pack of the flange sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.progress import in_parts, share_of
from counterflex.core.units import DEG, MINUTE, MM
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import BodyMass, Change, TableValues
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.payload import TITLE, data as sensor_data, hose_pack, residuals
from counterflex.identify.payload.checks import check_units
from counterflex.identify.payload.proposal import FORCE_N, HEIGHT_M, MOMENT_NM, NEAR_SHARE, propose
from counterflex.identify.payload.weight import check_axes, check_rest
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut
from counterflex.identify.solver.jackknife import parts_of_groups, with_groups_once, with_jackknife
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.sensing.carrier import hose_bodies
from counterflex.sensing.flange_sensor import COUNTS, FlangeSensor

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


@dataclass(frozen=True)
class _PayloadReader:
    """Files as residuals of one sensor, on one clock and about one temperature."""

    sensor: FlangeSensor
    start_s: float
    reference_c: float
    window_s: float

    def block(self, data: Dataset, chain: ElasticChain, hose_from: str = "") -> residuals.SensorReadings:
        """Readings of one file, with the hose pack from a body."""
        framed = replace(self.sensor, hose_from=hose_from)
        return sensor_data.readings(
            data, chain, framed, reference_c=self.reference_c, start_s=self.start_s, window_s=self.window_s
        )

    def blocks(
        self, data: Sequence[Dataset], groups: Sequence[Int], chain: ElasticChain, hose_from: str = ""
    ) -> list[residuals.SensorReadings]:
        """Readings of all files, grouped by orientation within and between them."""
        return [replace(self.block(d, chain, hose_from), group=g) for d, g in zip(data, groups, strict=True)]


def identify(inputs: Inputs) -> Identification:
    """Find the constants of the flange sensor from readings without a process.

    ``inputs``: The sensor before; ``sensor_poses`` and ``sensor_motion``. Setting ``hose`` is ``auto``, ``none``, ``1``
    or ``2`` (degree of its functions), or ``once`` (degree 1 in the base where the orientations suffice, compared with
    nothing); ``hose_from`` is ``auto``, ``base`` or the body that the hose pack comes from.

    Raises:
        InputError: Too few orientations, or data that fit far better when read otherwise.
        FileFormatError: A channel is missing or not a number.
    """
    cell, data, holdout, s, progress = inputs
    sensor, forced, as_stated = sensor_data.sensor_before(cell), str(s["hose"]) != "auto", bool(s["as_stated"])
    reader = _PayloadReader(sensor, *sensor_data.clock(data, sensor.reference_c), float(s["window_s"]))
    groups = sensor_data.groups_of(
        [reader.block(d, cell.chain) for d in data], [d.kind != "sensor_motion" for d in data]
    )
    blocks = reader.blocks(data, groups, cell.chain)
    degrees = hose_pack.degrees_of(s, sensor_data.count_of(blocks))
    each = dict.fromkeys((*data, *holdout))  # a file that judges itself is checked once
    frames = hose_pack.frames_of(s, hose_bodies(cell.chain, sensor.segment), with_joints=all(d.has("q") for d in each))
    parts = in_parts(progress, _work(hose_pack.trials_of(blocks, degrees, frames, forced=forced)))
    remarks = list(sensor_data.check_orientations(blocks, ", ".join(d.where or d.name for d in data)))
    as_read = partial(reader.block, chain=cell.chain)
    for i, d in enumerate(each):
        remarks += check_axes(d, as_read, as_stated=as_stated)
        remarks += check_units(d, sensor, as_read, as_stated=as_stated)
        parts[CHECKING]((i + 1) / len(each))
    before = _at(sensor, reader.reference_c)
    known = replace(
        residuals.Knowledge(),
        turn_rad=float(s["mounting_rad"]),
        offset_n=float(s["offset_n"]),
        offset_nm=float(s["offset_nm"]),
    )
    effects, chain = _effects(blocks, s), cell.chain
    shares = [share_of(parts[WEIGHT], i / (_ROUNDS + 1), (i + 1) / (_ROUNDS + 1), WEIGHT) for i in range(_ROUNDS + 1)]
    fit = solve(residuals.parameters(before, known, effects), blocks, progress=shares[0])
    for i in range(_ROUNDS):  # a heavier tool bends the arm more, which turns the sensor
        chain = sensor_data.with_added_mass(
            chain, sensor.segment, float(fit.values[6]), residuals.seg_frame_com(sensor, fit)
        )
        blocks = reader.blocks(data, groups, chain)
        fit = solve(residuals.parameters(before, known, effects), blocks, progress=shares[i + 1])
    parts[WEIGHT](1.0)
    # Before the hose pack is chosen: its trials are fitted with the effects that stay.
    effects = _significant(fit, effects)
    blocks_in = partial(reader.blocks, data, groups, chain)
    rest = hose_pack.choose_rest(blocks_in, before, known, effects, degrees, frames, parts[HOSE], forced=forced)
    parts[HOSE](1.0)
    effects = replace(effects, degree=rest.degree)
    chosen = residuals.parameters(before, known, effects)
    blocks = blocks_in(rest.hose_from)
    fit = solve(chosen, blocks)
    fit = with_jackknife(with_groups_once(fit, blocks), blocks, parts_of_groups(blocks))
    remarks += check_rest(blocks, fit, as_stated=as_stated)
    unseen = [reader.block(d, chain, rest.hose_from) for d in holdout]
    force = hose_pack.forces_of(rest, chosen, blocks, unseen, share_of(parts[HELD_OUT], 0.2, 0.6))
    moment = hose_pack.held_out_moments(force, chosen, blocks, unseen, share_of(parts[HELD_OUT], 0.6, 1.0))
    parts[HELD_OUT](1.0)
    identified = residuals.sensor_of(replace(sensor, hose_from=rest.hose_from), fit.values, reader.reference_c)
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


def _effects(blocks: Sequence[residuals.SensorReadings], s: Mapping[str, Any]) -> residuals.SensorEffects:
    time_s = np.concatenate([b.time_s for b in blocks])
    warm = np.concatenate([b.warmer_k for b in blocks])
    moving = any(np.any(b.alpha != 0.0) for b in blocks)
    return residuals.SensorEffects(
        drift=bool(s["drift"]) and float(np.ptp(time_s)) > 60.0,
        temperature=bool(s["temperature"]) and float(np.ptp(warm)) > 0.5,
        inertia=bool(s["inertia"]) and moving,
    )


def _significant(fit: Fit, effects: residuals.SensorEffects) -> residuals.SensorEffects:
    """Drift and temperature only where a component stands out of its noise."""
    clear = np.abs(fit.values - fit.parameters.nominal) > SIGNIFICANT * fit.sigma
    return replace(
        effects,
        drift=effects.drift and bool(np.any(clear[residuals.DRIFT])),
        temperature=effects.temperature and bool(np.any(clear[residuals.KELVIN])),
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
    turn = float(np.linalg.norm(fit.values[residuals.TURN]))
    return (
        Figure("holdout_p95_n", "force error, 95 % quantile, held-out orientations", *force.quantile(0.95)),
        Figure("holdout_p95_nm", "moment error, 95 % quantile, held-out orientations", *moment.quantile(0.95)),
        Figure("mass_kg", "mass behind the sensor", identified.mass_kg, float(fit.parameters.nominal[6])),
        Figure("mass_sigma_kg", "its standard deviation", fit.sigma_of("mass")),
        Figure("mounting_deg", "rotation of the sensor against the cell file", turn / DEG, 0.0),
        Figure("offset_degree", "degree of the hose terms", float(identified.degree), 0.0),
    )


def _changes(cell: CellModel, identified: FlangeSensor, effects: residuals.SensorEffects) -> tuple[Change, ...]:
    changes: list[Change] = [TableValues("sensor", _table(identified, effects))]
    chain = cell.chain
    split = sensor_data.shared_mass(chain, identified.segment, identified.mass_kg, _seg_com(identified))
    changes += [BodyMass(chain.names[i], kg, com) for i, (kg, com) in split.items()]
    return tuple(changes)


def _seg_com(identified: FlangeSensor) -> Float:
    out: Float = pose.transform(identified.T_seg_sensor, identified.p_sensor_com)
    return out


def _table(identified: FlangeSensor, effects: residuals.SensorEffects) -> dict[str, Any]:
    """The table of the cell file, in its units."""
    place = np.concatenate(
        [identified.T_seg_sensor[:3, 3] / MM, rotation.to_zyx(identified.T_seg_sensor[:3, :3]) / DEG]
    )
    table: dict[str, Any] = {
        "segment": identified.segment,
        **dict(zip(("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"), _rounded(place), strict=True)),
        "mass_kg": float(f"{identified.mass_kg:.6g}"),
        "com_mm": _rounded(identified.p_sensor_com / MM),
        "bias_n": _rounded(identified.w_bias[:3]),
        "bias_nm": _rounded(identified.w_bias[3:]),
        "reference_c": identified.reference_c,
        "offset": [_rounded(r) for r in identified.w_offset],
        "hose_from": identified.hose_from,
    }
    if effects.drift:
        table["drift_n_per_h"] = _rounded(identified.w_drift_per_s[:3] * _HOUR)
        table["drift_nm_per_h"] = _rounded(identified.w_drift_per_s[3:] * _HOUR)
    if effects.temperature:
        table["temperature_n_per_k"] = _rounded(identified.w_kelvin[:3])
        table["temperature_nm_per_k"] = _rounded(identified.w_kelvin[3:])
    if effects.inertia:
        table["inertia_kg_m2"] = _rounded(identified.inertia_kg_m2)
    return table


def _rounded(values: Float) -> list[float]:
    return [float(f"{v:.6g}") for v in values]


def _remarks(
    cell: CellModel,
    identified: FlangeSensor,
    fit: Fit,
    effects: residuals.SensorEffects,
    rest: hose_pack.HoseTerms,
    blocks: Sequence[residuals.SensorReadings],
) -> list[str]:
    out = []
    rows, count = sum(len(b.group) for b in blocks), sensor_data.count_of(blocks)
    if count < rows and not effects.inertia:
        out.append(
            f"{rows} readings in {count} different orientations: readings of one orientation count together, in the "
            "standard deviations and in the folds"
        )
    out.append(_mass_remark(cell.chain, identified))
    if len(rest.candidates) > 1:
        out += _hose_remarks(identified, rest)
    elif identified.degree == 0 and not effects.inertia:
        out.append(
            f"No hose terms were fitted; they need {hose_pack.ROWS_PER_FUNCTION * COUNTS[1]} or more different "
            f"orientations; the data have {count} (directions of gravity that differ by over "
            f"{sensor_data.ALIKE_RAD / DEG:.0f} deg; repeats and copies do not count)"
        )
    if identified.degree:
        out.append(
            "A hose force that rotates with gravity cannot be separated from weight; the standard deviations of "
            "mass and mounting include this"
        )
    if effects.drift and effects.temperature:
        share = _correlation(fit, "drift.fz", "temperature.fz")
        if abs(share) > 0.9:
            out.append(
                f"Temperature rose with time (correlation of their effects {share:.2f}): drift and temperature "
                "coefficients cannot be separated. Read the sensor again after it has cooled"
            )
    if np.all(identified.inertia_kg_m2 == 0.0):
        out.append("The inertia is not determined; record a motion (kind sensor_motion) to identify it")
    if effects.inertia and not np.all(np.linalg.eigvalsh(_tensor(fit.values[residuals.INERTIA])) > 0.0):
        out.append("The identified inertia is not that of a rigid body; the motion does not determine it")
    return out


def _mass_remark(chain: ElasticChain, identified: FlangeSensor) -> str:
    split = sensor_data.shared_mass(chain, identified.segment, identified.mass_kg, _seg_com(identified))
    if not split:
        return "The cell file has no body with mass behind the sensor, so only the table [sensor] is changed"
    return (
        f"The sensor measures the total mass behind it, {identified.mass_kg:.2f} kg; its distribution among the "
        "bodies is not determined. The difference from the cell file is assigned to "
        f"{', '.join(chain.names[i] for i in split)}"
    )


def _hose_remarks(identified: FlangeSensor, rest: hose_pack.HoseTerms) -> list[str]:
    listed = ", ".join(
        f"degree {degree} in {body}: {held_out.mean()[0]:.2f} N" if degree else f"none: {held_out.mean()[0]:.2f} N"
        for (body, degree), held_out in rest.candidates.items()
    )
    body, degree = identified.hose_from or hose_pack.BASE, identified.degree
    reason = (
        f"degree {degree} is used, with the rotation of the sensor in {body}"
        if degree
        else "none is used, as none improves held-out orientations"
    )
    return [
        f"Hose terms, error on held-out orientations: {listed}; {reason}",
        *(
            f"The hose terms of degree {degree} in {body} were not used: they would make the standard deviation of "
            f"the mass {cost:.0f} times larger"
            for (body, degree), cost in rest.dear.items()
        ),
    ]


def _correlation(fit: Fit, first: str, second: str) -> float:
    place = {int(k): n for n, k in enumerate(fit.free_index)}
    both = [place[fit.parameters.index(name)] for name in (first, second)]
    cov = fit.covariance[np.ix_(both, both)]
    return float(cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1]))


def _tensor(values: Float) -> Float:
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _pictures(blocks: Sequence[residuals.SensorReadings], force: HeldOut, moment: HeldOut) -> tuple[Picture, ...]:
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
    name="payload", title=TITLE, kinds=sensor_data.KINDS, settings=SETTINGS, find=identify, propose=propose,
    quick={"hose": "once"},
)  # fmt: skip
