"""The job ``thermal``: growth of spindle and arm from touches between cuts, and when something has to be done."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MINUTE, RPM, UM
from counterflex.evaluate.thermal.growth import GrowthCourse, GrowthModel, Touches, follow, micro
from counterflex.files.touches_file import read_touches

KIND, VERSION = "counterflex thermal", 2
_SIGMAS: Final = 2.0
_JUMPED: Final = (
    "the place jumped before the touch at {}: what was cut since then is off by as much. Look for the cause (clamping, "
    "tool, probe, target), touch the part again (datum points) and begin a new file"
)
_MAY_HAVE_JUMPED: Final = (
    "the place may have jumped before the touch at {}: touch the part again (datum points), or look for the cause "
    "(clamping, tool, probe, target)"
)
_KEYS: Final = ("reference_rpm", "end_um", "end_sigma_um", "weights")
_ADDED: Final = {2: ("walk_weights",)}


class ThermalGrowth(Summary):
    """Growth of spindle and arm, touch by touch."""

    def _shown(self) -> Parts:
        rows = [
            row
            | {
                "arm_sigma": max(row["arm_sigma_um"]),
                "jump": f" jump of {row['jump_um']:.0f}" if row["jump_um"] > 0.0 else "",
                "doubt": "" if row["holds"] else "?" if row["jump_um"] > 0.0 else " !",
            }
            for row in self["touches"]
        ]
        yield ShownTable.of(
            "Thermal growth, um",
            "minutes:g | rpm | spindle=growth_um:.1f | +-=growth_sigma_um:.1f | arm x=arm_um[0]:.1f | "
            "y=arm_um[1]:.1f | z=arm_um[2]:.1f | +-=arm_sigma:.1f | together=total_um:.1f | +-=total_sigma_um:.1f | "
            "surprise={surprise:.1f}{jump}{doubt}~-",
            rows,
        )
        yield self.line(
            "spindle: {end_um:.0f} +- {end_sigma_um:.0f} um in the end at {reference_rpm} rpm, time constant "
            "{time_constant_min:g} +- {time_constant_sigma_min:g} min"
        )
        yield from self.each("alerts", "alert: {}")


@dataclass(frozen=True)
class ThermalSettings:
    """Settings of the thermal model."""

    touches: Path
    axis_part: tuple[float, float, float] = (0.0, 0.0, -1.0)  # (3,) direction from the spindle to the tip, part axes
    limit_m: float = 30.0 * UM  # Largest growth or drift that is tolerated
    per_kelvin_m: float | None = None  # Growth per kelvin of the spindle's temperature, or None
    model: Path | None = None  # Written by an earlier call, or None

    def run(self, out: Path | None = None) -> ThermalGrowth:
        """Follow growth and drift through the touches, and judge them.

        Args:
            out: File for what was learnt of this machine; None writes none.

        Returns:
            Summary: a row per touch, the model, alerts; :attr:`alert` is whether there are any.

        Raises:
            InputError: Values that cannot be.
        """
        touches = read_touches(self.touches)
        before = _read(self.model, self.per_kelvin_m)
        course = follow(touches, np.array(self.axis_part), before)
        alerts = _alerts(touches, course, self.limit_m, known=self.model is not None)
        summary = {
            "touches": [_row(touches, course, k) for k in range(len(touches.time_s))],
            "time_constant_min": round(course.tau_s / MINUTE, 1),
            "time_constant_sigma_min": round(course.tau_sigma_s / MINUTE, 1),
            "end_um": micro(course.model.end_m),
            "end_sigma_um": micro(course.model.end_sigma_m),
            "reference_rpm": round(course.model.reference_rad_s / RPM),
            "limit_um": micro(self.limit_m),
            "alerts": alerts,
        }
        if out is not None:
            _write(out, course.model)
        return ThermalGrowth(summary)


def _row(touches: Touches, course: GrowthCourse, k: int) -> dict[str, Any]:
    return {
        "minutes": round(float(touches.time_s[k] - touches.time_s[0]) / MINUTE, 2),
        "rpm": round(float(touches.speed_rad_s[k]) / RPM),
        "growth_um": micro(course.growth_m[k]),
        "growth_sigma_um": micro(course.growth_sigma_m[k]),
        "arm_um": [micro(v) for v in course.arm_m[k]],
        "arm_sigma_um": [micro(v) for v in course.arm_sigma_m[k]],
        "total_um": micro(float(np.linalg.norm(course.total_m[k]))),
        "total_sigma_um": micro(_along(course.total_m[k], course.total_sigma_m[k])),
        "surprise": None if np.isnan(course.surprise_ratio[k]) else round(float(course.surprise_ratio[k]), 2),
        "holds": bool(course.holds[k]),
        "jump_um": micro(course.jump_m[k]),
        "jump_sigma_um": micro(course.jump_sigma_m[k]),
    }


def _along(d: Float, sigma: Float) -> float:
    """Standard deviation of the length of a vector whose components have these."""
    length = float(np.linalg.norm(d))
    return float(np.linalg.norm(d * sigma) / length) if length > 0.0 else float(sigma.max())


def _alerts(touches: Touches, course: GrowthCourse, limit_m: float, *, known: bool) -> list[str]:
    """Actions after the last touch, in words. A touch that was not foretold stays an alert for the rest of its file."""
    d, sigma = course.total_m[-1], course.total_sigma_m[-1]
    size, spread = float(np.linalg.norm(d)), _along(d, sigma)
    alerts = []
    if size - _SIGMAS * spread > limit_m:
        alerts.append(
            f"growth and drift of {micro(size):g} +- {micro(spread):g} um are beyond {micro(limit_m):g} um: touch the "
            "part again (datum points) before the next cut"
        )
    elif size + _SIGMAS * spread > limit_m:
        alerts.append(
            f"growth and drift may be beyond {micro(limit_m):g} um ({micro(size):g} +- {micro(spread):g} um): touch "
            "once more, or touch the part again"
        )
    minutes = (touches.time_s - touches.time_s[0]) / MINUTE
    for rows, what in ((~course.holds, _JUMPED), (course.holds, _MAY_HAVE_JUMPED)):
        named = [
            f"{minutes[k]:g} min ({micro(course.jump_m[k]):g} um, standard deviation {micro(course.jump_sigma_m[k]):g})"
            for k in np.flatnonzero(rows & (course.jump_m > 0.0))
        ]
        if named:
            alerts.append(what.format(", ".join(named)))
    if not np.all(course.holds[course.jump_m == 0.0]):
        whose = "the model of this machine" if known else "what machines do when they warm up"
        first = minutes[int(np.flatnonzero(~course.holds & (course.jump_m == 0.0))[0])]
        alerts.append(
            f"the touches up to {first:g} min are not what {whose} foretells: identify again; counterflex identify "
            "tracker-frame where a tracker shows the place, else touch the part, and counterflex identify kinematics "
            "where it stays"
        )
    return alerts


def _write(out: Path, model: GrowthModel) -> None:
    content = {
        "format": KIND,
        "version": VERSION,
        "reference_rpm": model.reference_rad_s / RPM,
        "end_um": model.end_m / UM,
        "end_sigma_um": model.end_sigma_m / UM,
        "weights": [float(w) for w in model.weights],
        "walk_weights": [float(w) for w in model.walk_weights],
    }
    atomic.write_text(out, json.dumps(content, indent=1) + "\n")


def _read(path: Path | None, per_kelvin_m: float | None) -> GrowthModel:
    if path is None:
        return GrowthModel(per_kelvin_m=per_kelvin_m)
    where = str(path)
    content = file_content.json_value(path, hint="counterflex thermal writes a model")
    if not isinstance(content, dict) or content.get("format") != KIND:
        raise FileFormatError("not a model of thermal growth", where=where, hint="counterflex thermal writes one")
    version = content.get("version")
    added = [key for since, keys in _ADDED.items() for key in keys if isinstance(version, int) and version >= since]
    if version not in range(1, VERSION + 1) or set(content) != {"format", "version", *_KEYS, *added}:
        raise FileFormatError("a model of another version", where=where, value=version, limit=VERSION)
    try:
        model = (
            GrowthModel()
            if version == 1
            else GrowthModel(walk_weights=np.array(content["walk_weights"], dtype=np.float64))
        )
        return replace(
            model,
            reference_rad_s=float(content["reference_rpm"]) * RPM,
            end_m=float(content["end_um"]) * UM,
            end_sigma_m=float(content["end_sigma_um"]) * UM,
            weights=np.array(content["weights"], dtype=np.float64),
            per_kelvin_m=per_kelvin_m,
        )
    except (TypeError, ValueError, InputError) as fault:
        raise FileFormatError("a model with numbers that cannot be", where=where, value=str(fault)[:120]) from fault
