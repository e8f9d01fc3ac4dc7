"""The circular motion that CATIA writes, in two statements.

``INDIRV/ i,j,k`` and ``TLON,GOFWD/ (CIRCLE/ x,y,z,r),ON,(LINE/ x,y,z,xe,ye,ze)``: the tool is on a circle parallel to
the xy plane, sets off in the direction of INDIRV, and goes on until it is on the line from the centre to the end;
``ON,2,INTOF`` says that this is the second point of the line that it meets: an arc of more than half a turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs.gcode.read.arc import Arc, ArcFault

TOOL_ON_FORM: Final = "As CATIA writes it: INDIRV/i,j,k and TLON,GOFWD/(CIRCLE/x,y,z,r),ON,(LINE/x,y,z,xe,ye,ze)"
_SAME_M: Final = 2e-5  # Two points of a file are one within its rounding and a little more
_HALF_RAD: Final = 1e-3  # Arcs this close to half a turn may stand with INTOF and without
_DIRECTION_DIGITS: Final = 6


@dataclass(frozen=True)
class ToolOnCircle:
    """Numbers of the statement, m."""

    p_centre: Float  # (3,)
    radius_m: float  # Of the circle
    p_line: Float  # (3,), where the line begins
    p_end: Float  # (3,), where it ends
    second: bool  # The second intersection is meant

    @classmethod
    def of(cls, values: Sequence[float], unit_m: float, second: bool) -> ToolOnCircle:
        """From the ten numbers of the statement and the unit of the file."""
        v = np.asarray(values, dtype=np.float64) * unit_m
        return cls(v[:3], float(v[3]), v[4:7], v[7:], second)

    def fault(self, p_start: Float, direction: Sequence[float]) -> str | None:
        """Return its fault at the start (3,) m of the motion with the direction (3,) of INDIRV; None: none."""
        near = _SAME_M + 1e-3 * self.radius_m
        flat = float(np.ptp([p_start[2], self.p_end[2], self.p_centre[2]]))
        if flat > _SAME_M:
            return f"the circle leaves its height by {1e3 * flat:.3f} mm"
        if float(np.linalg.norm(self.p_line - self.p_centre)) > near:
            return "the line does not begin at the centre of the circle"
        for p, name in ((p_start, "start"), (self.p_end, "end")):
            off = abs(float(np.linalg.norm((p - self.p_centre)[:2])) - self.radius_m)
            if off > near:
                return f"the {name} of the motion is {1e3 * off:.3f} mm beside the circle"
        out = (p_start - self.p_centre)[:2]
        across = abs(out[0] * direction[1] - out[1] * direction[0])
        if across < 0.5 * self.radius_m * math.hypot(*direction):
            return "INDIRV does not point along the circle"
        return None

    def arc(self, p_start: Float, direction: Sequence[float], unit_m: float) -> Arc:
        """The arc from the start (3,) m in the direction (3,) of INDIRV; ``unit_m`` is that of the file.

        Raises:
            ArcFault: There is no such arc, or the line is met before its end.
        """
        if (what := self.fault(p_start, direction)) is not None:
            raise ArcFault(what, "")
        out = (p_start - self.p_centre)[:2]
        clockwise = float(out[0] * direction[1] - out[1] * direction[0]) < 0.0
        ends = [(float(q[0]), float(q[1])) for q in (p_start, self.p_end, self.p_centre)]
        arc = Arc.by_centre(ends[0], ends[1], ends[2], clockwise, 1, unit_m)
        turn = abs(arc.turn_rad)
        if abs(turn - math.pi) > _HALF_RAD and (turn > math.pi) != self.second:
            need = "needs ON,2,INTOF" if turn > math.pi else "needs ON alone"
            raise ArcFault(
                f"the end is not the first point of the line that the circle meets: an arc of "
                f"{math.degrees(turn):.1f} deg {need}", ""
            )  # fmt: skip
        return arc


def written(
    p_start: Float, p_centre: Float, radius_m: float, p_end: Float, turn_rad: float, coordinate: Callable[[float], str]
) -> list[str]:
    """Lines of a circular motion.

    Args:
        p_start: (3,) m.
        p_centre: (3,) m.
        p_end: (3,) m.
        turn_rad: Positive is counter-clockwise seen from +z.
        coordinate: A length in m as it is written.
    """
    out = (p_start - p_centre)[:2] * math.copysign(1.0, turn_rad) / max(radius_m, 1e-12)
    along = ",".join(f"{value:.{_DIRECTION_DIGITS}f}" for value in (-out[1], out[0], 0.0))
    centre = ",".join(coordinate(float(value)) for value in p_centre)
    end = ",".join(coordinate(float(value)) for value in p_end)
    second = "2,INTOF," if abs(turn_rad) > math.pi else ""
    return [
        f"INDIRV/{along}",
        f"TLON,GOFWD/(CIRCLE/{centre},$",
        f"{coordinate(radius_m)}),ON,{second}(LINE/{centre},$",
        f"{end})",
    ]
