"""Recipe ``play``: dead band and dry friction of the axes from slow reversals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, share_of
from counterflex.core.units import MRAD, MS, URAD
from counterflex.identify.data.changes import AxisPlay
from counterflex.identify.data.model import CellModel
from counterflex.identify.play import TITLE, parameters as play_parameters
from counterflex.identify.play.data import ReversalMotion, motions, motor_friction
from counterflex.identify.play.proposal import propose
from counterflex.identify.play.residuals import LARGE_RAD, AxisResiduals, ReversalResiduals
from counterflex.identify.recipe import Curve, Figure, Identification, Inputs, Picture, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, score_separate
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import Stop, solve
from counterflex.robot.model.description import Play

BEARING_M: Final = 0.01
"""How far off its axis the torsion of a gear and its bearing may turn, one standard deviation."""
_NONE_RAD: Final = 0.5 * URAD
"""A half band below this is none: no reading resolves it, and a cell file takes it for another unit."""
_STOP: Final = Stop(tolerance=1e-8, evaluations=60)
_SHOWN = 800


def angle_error(block: Residuals, x: Float) -> Float:
    """Error of the link's angle by the model, rad: (rows,)."""
    if not isinstance(block, AxisResiduals):
        raise InputError("the error of an angle is that of reversal motions", where=block.name)
    return block.angle_error(x)


def identify(inputs: Inputs) -> Identification:
    """Find play and friction axis by axis; see :mod:`counterflex.identify.play.residuals` for the model.

    ``inputs``: Compliance and weights, play known before; ``reversals``, held out by motions.

    Returns:
        A fit for each axis that moved, ``[[robot.play]]`` of these.

    Raises:
        FileFormatError: See :func:`counterflex.identify.play.data.motions`.
        InputError: See there; or torque and motion contradict each other.
    """
    cell, data, holdout, settings, progress = inputs
    records = motions(cell, data)
    mine, unseen = _by_axis(records), _by_axis(motions(cell, holdout, len(records)))
    work = {f"axis {axis + 1}": float(sum(len(m.q) for m in mine[axis])) for axis in mine}
    parts = in_parts(progress, work) if work else {}
    estimates = [
        _axis(cell, axis, mine[axis], unseen.get(axis, []), settings, parts[f"axis {axis + 1}"]) for axis in mine
    ]
    used = _trusted(estimates, records, as_stated=bool(settings["as_stated"]))
    remark_end = "used as stated, as requested" if settings["as_stated"] else "its values are not written"
    withheld = [f"{one.withheld}; {remark_end}." for one in estimates if one.withheld is not None]
    return Identification(
        "play",
        {f"axis {one.axis + 1}": one.fit for one in estimates},
        _headline([one.errors for one in used if one.errors is not None]),
        tuple(chain.from_iterable(one.figures for one in estimates)),
        tuple(AxisPlay(one.axis, resolved(one.play)) for one in used),
        (*withheld, *chain.from_iterable(one.remarks for one in estimates)),
        tuple(chain.from_iterable(one.pictures for one in estimates)),
    )


def _by_axis(records: Sequence[ReversalMotion]) -> dict[int, list[ReversalMotion]]:
    return {axis: [m for m in records if m.axis == axis] for axis in sorted({m.axis for m in records})}


def _trusted(
    estimates: Sequence[_AxisResult], records: Sequence[ReversalMotion], *, as_stated: bool
) -> list[_AxisResult]:
    """Axes whose values are used; refuse data of which none are."""
    judged = [one for one in estimates if one.errors is not None]
    if not judged:
        raise InputError(
            "each axis has one motion only, so none can be held out",
            value=len(records),
            limit="two motions of an axis",
            hint="Record a second motion (another pose, speed or amplitude), or give a separate file with --holdout",
        )
    used = [one for one in judged if one.withheld is None or as_stated]
    if not used:
        raise InputError(
            "play and friction of no axis can be trusted",
            where=records[0].where,
            value=f"{len(estimates)} axes",
            hint=f"{judged[0].withheld}. If the data are right, add --set as_stated=true",
        )
    return used


@dataclass(frozen=True, eq=False)
class _AxisResult:
    """Result of the motions of one axis; ``withheld`` says why its values are not to be used."""

    axis: int
    fit: Fit
    play: Play
    errors: HeldOut | None
    withheld: str | None
    figures: Sequence[Figure]
    remarks: Sequence[str]
    pictures: Sequence[Picture]


def _axis(
    cell: CellModel,
    axis: int,
    mine: Sequence[ReversalMotion],
    other: Sequence[ReversalMotion],
    settings: Mapping[str, Any],
    progress: Progress,
) -> _AxisResult:
    remarks = _turned_torque(mine, bool(settings["as_stated"]))
    large = any(m.by == "encoder" and float(np.ptp(m.q)) > LARGE_RAD for m in mine)
    p, places = play_parameters.parameters(
        cell, axis, free_compliance=large, delay=all(m.time_s is not None for m in mine)
    )
    rows = [AxisResiduals(tuple(play_parameters.blocks(mine, places)))]
    plain = solve(p, rows, robust=False, stop=_STOP, progress=share_of(progress, 0.0, 0.3, f"axis {axis + 1}"))
    fit = play_parameters.with_honest_sigma(plain, rows[0])
    needed = [name for name in p.names if name.endswith(".delay")]
    turn_spread = 0.0
    errors: HeldOut | None = None
    if other:
        unseen = [AxisResiduals(tuple(play_parameters.blocks(other, places)))]
        errors = score_separate(p, rows, unseen, needed=needed, error=angle_error, robust=False, stop=_STOP)
    elif len(mine) > 1:
        errors = cross_validate(
            p,
            rows,
            needed=needed,
            error=angle_error,
            folds=Folds(min(4, len(mine))),
            robust=False,
            stop=_STOP,
            start=fit.values,
            progress=share_of(progress, 0.3, 1.0, f"axis {axis + 1}"),
        )
        fit = _at_least(fit, jackknife([part.values for part in errors.fits]))
        turn_spread = float(jackknife([np.array([turn(part, axis)]) for part in errors.fits])[0])
    share = float(settings["bearing_m"]) / min(m.lever_m for m in mine)
    fit = play_parameters.with_spread(_with_bearing(fit, share), play_parameters.compliance_share(plain, rows[0]))
    play = _play(fit, axis)
    friction = _link_friction(fit, axis, turn_spread)
    withheld = play_parameters.why_not(axis, mine, *friction)
    fit, wide = _named(fit, axis, friction, withheld is not None)
    progress(1.0)
    return _AxisResult(
        axis,
        fit,
        play,
        errors,
        withheld,
        _figures(cell, fit, axis, play, mine, (turn_spread, share)),
        [*remarks, *wide, *_remarks(cell, fit, axis, play, mine)],
        [_loop(b, fit, m) for b, m in list(zip(rows[0].parts, mine, strict=True))[:2]],
    )


def resolved(play: Play) -> Play:
    """The same without a dead band that is below :data:`_NONE_RAD`: a fit at its bound says that there is none."""
    return play if play.half_band_rad >= _NONE_RAD else replace(play, half_band_rad=0.0)


def _play(fit: Fit, axis: int) -> Play:
    name = f"axis{axis + 1}"
    count = sum(n.startswith(f"{name}.friction") for n in fit.parameters.names)
    return Play(
        max(fit.value(f"{name}.half_band"), 0.0),
        tuple(fit.value(f"{name}.friction{e + 1}") for e in range(count)),
        tuple(fit.value(f"{name}.slip{e + 1}") for e in range(count)),
    )


def _headline(errors: Sequence[HeldOut]) -> tuple[Figure, ...]:
    identified = np.concatenate([e.identified for e in errors]) / URAD
    nominal = np.concatenate([e.nominal for e in errors]) / URAD
    return (
        Figure(
            "holdout_rms_urad",
            "angle of the link predicted for motions not used, root mean square error (noise of the measurement "
            "included), urad",
            float(np.sqrt(np.mean(identified**2))),
            float(np.sqrt(np.mean(nominal**2))),
        ),
        Figure(
            "holdout_p95_urad",
            "the same, not exceeded by 95 %, urad",
            float(np.quantile(identified, 0.95)),
            float(np.quantile(nominal, 0.95)),
        ),
    )


def loop_half_width(fit: Fit, axis: int) -> tuple[float, float]:
    """Half the width of the loop that friction opens on a loaded axis, ``c sum F``, and its standard deviation, rad."""
    name = f"axis{axis + 1}"
    p = fit.parameters
    names = [n for n in p.names if n.startswith(f"{name}.friction")]
    soft = fit.value(f"{name}.compliance")
    places = [int(np.flatnonzero(fit.free_index == p.index(n))[0]) for n in names]
    slope = np.array([fit.value(n) * p.items[p.index(n)].unit_step for n in names])
    part = fit.covariance[np.ix_(places, places)]
    return soft * sum(fit.value(n) for n in names), soft * float(np.sqrt(slope @ part @ slope))


def turn(fit: Fit, axis: int) -> float:
    """Torsion by dry friction, half the loop of a loaded axis: ``c sum F``, rad."""
    name = f"axis{axis + 1}"
    return fit.value(f"{name}.compliance") * sum(
        fit.value(n) for n in fit.parameters.names if n.startswith(f"{name}.friction")
    )


def _link_friction(fit: Fit, axis: int, turn_spread: float) -> tuple[float, float]:
    """Dry friction of an axis on the side of the link, N m, and its standard deviation."""
    width, sigma = loop_half_width(fit, axis)
    soft = fit.value(f"axis{axis + 1}.compliance")
    held = 0.0 if fit.parameters.items[0].free else play_parameters.COMPLIANCE
    total = width / soft
    return total, float(np.hypot(max(sigma, turn_spread) / soft, held * total))


def _named(fit: Fit, axis: int, friction: tuple[float, float], withheld: bool) -> tuple[Fit, list[str]]:
    """The fit without calling constants determined that are withheld or too wide, and what is said of the latter."""
    name = f"axis{axis + 1}"
    band = fit.value(f"{name}.half_band"), fit.sigma_of(f"{name}.half_band")
    # A dead band below what any reading resolves is none, whatever its standard deviation is to it.
    wide = {
        "half_band": band[0] > _NONE_RAD and play_parameters.too_wide(*band),
        "friction": play_parameters.too_wide(*friction),
    }
    out = [
        f"axis {axis + 1}: {what} is not determined ({value / unit:.3g} +- {sigma / unit:.2g} {word}); measure more "
        f"poses (identify play --propose 24)"
        for key, what, (value, sigma), unit, word in (
            ("half_band", "half dead band", band, URAD, "urad"),
            ("friction", "friction", friction, 1.0, "N m"),
        )
        if wide[key] and not withheld
    ]
    seen = tuple(
        "partly" if how == "determined" and (withheld or any(wide[k] and _about(n, k) for k in wide)) else how
        for n, how in zip(fit.parameters.names, fit.seen, strict=True)
    )
    return replace(fit, seen=seen), out


def _about(name: str, key: str) -> bool:
    """Return whether a parameter is the half band, or one of friction and its slip."""
    constant = name.split(".")[1]
    return constant.startswith(key) or (key == "friction" and constant.startswith("slip"))


def jackknife(values: Sequence[Float]) -> Float:
    """Standard deviations (p,) from the values (p,) that each of k folds left out gave."""
    spread = np.array(values)
    k = len(spread)
    out: Float = np.sqrt((k - 1) / k * np.sum((spread - spread.mean(axis=0)) ** 2, axis=0))
    return out


def _at_least(fit: Fit, sigma: Float) -> Fit:
    return replace(fit, sigma=np.where(fit.sigma > 0.0, np.maximum(fit.sigma, sigma), 0.0))


def _with_bearing(fit: Fit, share: float) -> Fit:
    """Add a share of play and friction: what turns about a bearing off the axis moves a tool by another lever."""
    scaled = np.array([part.split(".")[1].startswith(("half_band", "friction")) for part in fit.parameters.names])
    extra = np.where(scaled, share * np.abs(fit.values), 0.0)
    return replace(fit, sigma=np.where(fit.sigma > 0.0, np.hypot(fit.sigma, extra), 0.0))


def _figures(
    cell: CellModel, fit: Fit, axis: int, play: Play, mine: Sequence[ReversalMotion], more: tuple[float, float]
) -> list[Figure]:
    name, before = f"axis{axis + 1}", play_parameters.axis_play(cell, axis)[0]
    width, sigma = loop_half_width(fit, axis)
    sigma = float(np.hypot(max(sigma, more[0]), more[1] * width))
    old = play_parameters.compliance(cell, axis) * sum(before.friction_nm)
    out = [
        Figure(
            f"{name}_half_band_urad",
            f"half dead band of axis {axis + 1}, urad",
            play.half_band_rad / URAD,
            before.half_band_rad / URAD,
        ),
        Figure(
            f"{name}_half_band_sigma_urad", "its standard deviation, urad", fit.sigma_of(f"{name}.half_band") / URAD
        ),
        Figure(
            f"{name}_friction_turn_urad",
            f"torsion by dry friction of axis {axis + 1}, half the loop, urad",
            width / URAD,
            old / URAD,
        ),
        Figure(f"{name}_friction_turn_sigma_urad", "its standard deviation, urad", sigma / URAD),
    ]
    if f"{name}.delay" in fit.parameters.names:
        out.append(
            Figure(f"{name}_delay_ms", "delay of what saw the link, taken out, ms", fit.value(f"{name}.delay") / MS)
        )
    torque = motor_friction(mine)
    if torque is not None:
        out.append(
            Figure(
                f"{name}_motor_loop_nm",
                f"half the loop of the motor's torque of axis {axis + 1}: dry friction of link and motor, N m",
                torque,
            )
        )
    return out


def _turned_torque(mine: Sequence[ReversalMotion], as_stated: bool) -> list[str]:
    half = motor_friction(mine)
    if half is None or half > 0.0:
        return []
    text = (
        f"the motor of axis {mine[0].axis + 1} pushes against its own motion ({half:.3g} N m): "
        "the sign of 'tau_motor' looks turned round"
    )
    if as_stated:
        return [f"{text}; used as stated, as requested"]
    raise InputError(
        text,
        where=mine[0].where,
        hint="Write signs = [...] under [channels.tau_motor]. If the data are right, add --set as_stated=true",
    )


def _remarks(cell: CellModel, fit: Fit, axis: int, play: Play, mine: Sequence[ReversalMotion]) -> list[str]:
    out = [f"axis {axis + 1}: {sentence}" for sentence in fit.hidden]
    total = sum(play.friction_nm)
    missing = play_parameters.least_seen(axis, mine, total)
    if missing is not None:
        out.append(missing)
    if fit.parameters.items[0].free is False:
        out.append(
            f"axis {axis + 1}: friction refers to the torsion compliance of the cell file "
            f"({play_parameters.compliance(cell, axis) * 1e9:.3g} urad/(kN m)); only their product is determined"
        )
    torque = motor_friction(mine)
    if torque is not None:
        out.append(
            f"axis {axis + 1}: the motor's torque shows {torque:.3g} N m of dry friction in all, of which "
            f"{total:.3g} N m on the side of the link: {max(torque - total, 0.0):.3g} N m are the motor's "
            "(friction_nm of [[robot.servo]])"
        )
    return out


def _loop(block: ReversalResiduals, fit: Fit, motion: ReversalMotion) -> Picture:
    by_model, measured = block.shape(fit.values)
    every = slice(None, None, max(1, len(by_model) // _SHOWN))
    x = (block.q - block.q.mean())[every] / MRAD
    return Picture(
        f"Axis {motion.axis + 1}, motion {motion.run + 1}: lost motion over motor angle",
        "motor angle, mrad",
        "link minus motor without elastic torsion, urad",
        (Curve("measured", x, measured[every] / URAD), Curve("model", x, by_model[every] / URAD, True)),
        note=f"Torque of the weight {float(np.mean(motion.torque)):.0f} N m; the delay is taken out.",
    )


RECIPE: Final = Recipe(
    name="play",
    title=TITLE,
    kinds=("reversals",),
    settings={"bearing_m": BEARING_M, "as_stated": False},
    find=identify,
    propose=propose,
)
