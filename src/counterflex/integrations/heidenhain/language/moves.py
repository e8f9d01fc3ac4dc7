"""Motions of Klartext: L, LP, LN, C, CP, CR, CT, CTP, RND, dwells and drilling cycles.

Source: HEIDENHAIN TNC 640 (34059x-05), Conversational Programming, "Path contours" in Cartesian and polar coordinates;
iTNC 530 (60642x-03), "Corner rounding RND" (tangential to both elements, its feed acts in its block only), and
"Polar coordinates" (a pole in X/Y, Y/Z or Z/X; angles count from +X, +Y or +Z).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MINUTE
from counterflex.integrations.heidenhain.language.cycles import Drilling
from counterflex.integrations.heidenhain.language.source import KlartextStatement
from counterflex.integrations.heidenhain.language.state import MAIN_PLANE, PLANES, Plane
from counterflex.integrations.heidenhain.language.targets import KlartextTargets
from counterflex.integrations.heidenhain.language.words import AXES, PathWords
from counterflex.programs.gcode.read.arc import Arc, ArcFault
from counterflex.programs.gcode.read.motion import FARTHEST_M

_SAME_M: Final = 1e-9
_STRAIGHT: Final = 1e-9


class KlartextMoveMaker(KlartextTargets):
    """Turns path statements into motions and moves the state along."""

    # ---- statements --------------------------------------------------------------------------------------------

    def straight(self, words: PathWords, number: int, *, rapid: bool, polar: bool = False) -> None:
        """Execute L, LN or LP."""
        self.require_place(words)
        state = self._state
        state.plane = state.pole_axes if polar else MAIN_PLANE
        plane, where = self._polar_point(words) if polar else (None, None)
        moves = polar or words.has(*AXES, *(f"I{c}" for c in AXES))
        angles = self._angles(words)
        if not moves and angles == state.angles:
            return
        if not rapid:
            self.require_axes(words, "a feed motion") if state.partial is None else None
        p_end = self.target(words, rapid=rapid, p_plane=plane)
        if not rapid:
            self.require_axes(words, "a feed motion")
        state.polar_point = where
        state.motion = "G0" if rapid else "G1"
        if p_end is None:
            state.angles = angles
            return
        if rapid:
            self._refuse_corner(words)
            self._append(number, "rapid", p_end, angles=angles)
            return
        turned = math.dist(state.angles, angles)
        feed = self._feed(words, math.dist(state.p_part, p_end), turned)
        if self.corner is not None:
            self._round(words, p_end)
        self._append(number, "feed", p_end, feed, angles)

    def arc(self, words: PathWords, number: int, *, kind: str) -> None:
        """Execute C, CR or CT to an end in Cartesian coordinates, CTP to a polar one."""
        self.require_place(words)
        state = self._state
        state.plane = state.pole_axes if kind == "C" else MAIN_PLANE
        self.require_axes(words, "an arc")
        self._refuse_corner(words)
        if kind == "CTP" and state.pole_axes != MAIN_PLANE:
            raise words.fault("CTP about a pole in another plane than that of X and Y", None, "Write C or CP")
        if state.settle:
            raise words.fault("an arc as the first motion behind cycle 8, 10 or 26", None, "Go to its start before")
        start = state.to_work(state.p_part)
        sense, radius = words.take("DR"), words.take("R") if kind == "CR" else None
        plane, where = self._polar_point(words) if kind == "CTP" else (None, None)
        p_end = self.target(words, rapid=False, p_plane=plane)
        assert p_end is not None
        end = state.to_work(p_end)
        first, second, third = state.plane
        if abs(end[third] - start[third]) > _SAME_M:
            raise words.fault(f"{kind} with a motion along {AXES[third]}, out of its plane", None,
                              f"Write a helix as CP with IPA and I{AXES[third]}")  # fmt: skip
        a, b = (float(start[first]), float(start[second])), (float(end[first]), float(end[second]))
        try:
            solution = self._solved(words, kind, a, b, sense, radius)
        except ArcFault as fault:
            raise words.fault(f"{fault.what} ({fault.value})" if fault.value else fault.what, None) from fault
        state.polar_point = where
        self._append_arc(words, number, solution, p_end)

    def _solved(
        self,
        words: PathWords,
        kind: str,
        a: tuple[float, float],
        b: tuple[float, float],
        sense: float | None,
        radius: float | None,
    ) -> Arc:
        state = self._state
        if kind in ("CT", "CTP"):
            return self._tangential(words, a, b)
        if sense is None:
            raise words.fault(f"{kind} without its direction of rotation", None, "Write DR+ or DR-")
        if kind == "CR":
            if radius is None:
                raise words.fault("CR without its radius", None, "CR X+20 Y+0 R+10 DR-")
            return Arc.by_radius(a, b, radius * state.unit_m, sense < 0.0, 1, state.unit_m)
        if state.pole_m is None:
            raise words.fault("C without a circle centre", None, "Write CC before, behind the last change of datum")
        return Arc.by_centre(a, b, state.pole_m, sense < 0.0, 1, state.unit_m)

    def _tangential(self, words: PathWords, a: tuple[float, float], b: tuple[float, float]) -> Arc:
        """The arc from ``a`` in the direction of the last motion to ``b``: it turns by twice the angle of the chord."""
        direction = self._direction(words)
        chord = np.array(b) - np.array(a)
        size = float(np.linalg.norm(chord))
        if size < _SAME_M:
            raise words.fault("a tangential arc must end elsewhere than it starts", None)
        angle = math.atan2(direction[0] * chord[1] - direction[1] * chord[0], float(direction @ chord))
        if abs(math.sin(angle)) < 1e-7:
            raise words.fault("the end of the tangential arc lies on its tangent", None, "Write L")
        radius = size / (2.0 * math.sin(angle))
        centre = np.array(a) + radius * np.array([-direction[1], direction[0]])
        return Arc(float(centre[0]), float(centre[1]), 2.0 * angle, abs(radius))

    def _direction(self, words: PathWords) -> Float:
        """Unit vector (2,) in the plane, of the last motion at its end."""
        last = self.motions[-1] if self.motions else None
        if last is None or last.kind not in ("feed", "arc"):
            raise words.fault("a tangential arc needs a feed motion right before it", None, "Write L before, or CR")
        step = np.asarray(last.p_end) - np.asarray(last.p_start)
        if last.p_centre is not None and last.normal is not None:
            step = np.cross(last.normal, np.asarray(last.p_end) - last.p_centre) * math.copysign(1.0, last.turn_rad)
        flat: Float = np.asarray(np.linalg.solve(self._state.frames.A, step)[:2], dtype=np.float64)
        size = float(np.linalg.norm(flat))
        if size < _SAME_M:
            raise words.fault("a tangential arc behind a motion along the tool axis", None, "Write CR or C")
        out: Float = flat / size
        return out

    def _append_arc(self, words: PathWords, number: int, solution: Arc, p_end: Float) -> None:
        state = self._state
        A = state.frames.A
        scales = np.linalg.norm(A, axis=0)
        first, second, third = state.plane
        if abs(scales[first] - scales[second]) > 1e-9:
            raise words.fault(f"an arc under different scales of {AXES[first]} and {AXES[second]}", None,
                              "Cycle 26: the same factor for both")  # fmt: skip
        centre = state.to_work(state.p_part)
        centre[[first, second]] = solution.first, solution.second
        normal: Float = A[:, third] / scales[third]
        turn = solution.turn_rad * math.copysign(1.0, float(np.linalg.det(A)))
        rise = float((p_end - state.p_part) @ normal)
        feed = self._feed(words, math.hypot(solution.radius_m * float(scales[first]) * turn, rise), 0.0)
        state.motion = "G3" if solution.turn_rad > 0.0 else "G2"
        self._append(number, "arc", p_end, feed, arc=(state.to_part(centre), normal, turn))

    def polar_arc(self, words: PathWords, number: int) -> None:
        """Execute CP: about the pole by PA or IPA, as a helix with the axis out of its plane."""
        self.require_place(words)
        state = self._state
        state.plane = state.pole_axes
        self.require_axes(words, "an arc")
        self._refuse_corner(words)
        if state.pole_m is None:
            raise words.fault("CP without a pole", None, "Write CC before, behind the last change of datum")
        sense, angle, step = words.take("DR"), words.take("PA"), words.take("IPA")
        if (angle is None) == (step is None):
            raise words.fault("CP needs PA or IPA", None, "CP IPA+360 IZ-2 DR+")
        start = state.to_work(state.p_part)
        spoke = tuple(float(start[axis]) - pole for axis, pole in zip(state.plane, state.pole_m, strict=False))
        radius, begin = math.hypot(*spoke), math.atan2(spoke[1], spoke[0])
        if radius < _SAME_M:
            raise words.fault("CP begins at its pole", None)
        if sense is None and step is None:
            raise words.fault("CP without its direction of rotation", None, "Write DR+ or DR-")
        if step is not None:
            turn = step * DEG
            if sense is not None and sense * turn < 0.0:
                raise words.fault("IPA and DR have different signs", "IPA", "Give both the same sign")
            if turn == 0.0:
                raise words.fault("an arc of no angle", "IPA")
        else:
            assert angle is not None
            assert sense is not None
            turn = math.fmod(sense * (angle * DEG - begin), 2.0 * math.pi)
            turn = sense * (turn if turn > 1e-9 else turn + 2.0 * math.pi)
        last = begin + turn
        at = (state.pole_m[0] + radius * math.cos(last), state.pole_m[1] + radius * math.sin(last))
        p_end = self.target(words, rapid=False, p_plane=at)
        assert p_end is not None
        self._append_arc(words, number, Arc(*state.pole_m, turn, radius), p_end)
        state.polar_point = (radius, last)

    def _polar_point(self, words: PathWords) -> tuple[tuple[float, float], tuple[float, float]]:
        """Coordinates in the plane of the pole, m, of PR and PA, and these."""
        state = self._state
        if state.pole_m is None:
            raise words.fault("polar coordinates without a pole", None, "Write CC before")
        values = []
        for k, (name, unit) in enumerate((("PR", state.unit_m), ("PA", DEG))):
            value, incremental = words.coordinate(name) or (0.0, True)
            if incremental and state.polar_point is None:
                raise words.fault(f"{name} counts from a polar position, and the last motion ended elsewhere",
                                  f"I{name}", f"Write {name}")  # fmt: skip
            before = state.polar_point[k] if incremental and state.polar_point is not None else 0.0
            values.append(before + value * unit)
        radius, angle = values
        x, y = state.pole_m
        return (x + radius * math.cos(angle), y + radius * math.sin(angle)), (radius, angle)

    def centre(self, words: PathWords) -> None:
        """Execute CC: the pole and its plane; without coordinates where the tool stands, in X and Y."""
        state = self._state
        named = [axis for axis, letter in enumerate(AXES) if words.has(letter, f"I{letter}")]
        axes = state.plane = self._pole_plane(words, named)
        incremental = words.has(*(f"I{letter}" for letter in AXES))
        if (not named or incremental) and (state.partial is not None or state.shifted or state.settle):
            raise words.fault("CC counts from where the tool stands behind a change of datum", None, "CC X+10 Y+20")
        here = state.to_work(state.p_part).tolist()
        pole = [self._pole(words, axis, here[axis]) if named else here[axis] for axis in axes[:2]]
        if not named and len(state.named & {0, 1}) < 2 and not state.start_known:
            raise words.fault("CC takes the place of the tool, which is not known", None, "CC X+10 Y+20")
        if max(map(abs, pole)) > FARTHEST_M:
            raise words.fault("the pole is beyond any machine", None, "At most 1000 m")
        state.pole_axes, state.pole_m, state.polar_point = axes, (pole[0], pole[1]), None

    def _pole_plane(self, words: PathWords, named: list[int]) -> Plane:
        """Plane of a CC: that of the two axes it names; with one, the plane of X and Y where it has this axis."""
        if len(named) == 2:
            return next(axes for axes in PLANES.values() if set(axes[:2]) == set(named))
        if len(named) == 3 or 2 in named or (named and self._state.pole_axes != MAIN_PLANE):
            raise words.fault("the plane of a CC is not clear", AXES[named[-1]],
                              "Name the two axes of its plane: CC Y+20 Z-5")  # fmt: skip
        return MAIN_PLANE

    def _pole(self, words: PathWords, axis: int, here_m: float) -> float:
        """One coordinate of a CC that names one or both, m in programmed axes."""
        state, letter, given = self._state, AXES[axis], words.coordinate(AXES[axis])
        if given is None:
            if state.pole_m is None:
                raise words.fault(f"CC without {letter}, and none before", None, "CC X+10 Y+20")
            return state.pole_m[axis]
        value, incremental = given
        if incremental and axis not in state.named and not state.start_known:
            raise words.fault(f"CC counts from a place along {letter} that is not known", f"I{letter}")
        return value * state.unit_m + (here_m if incremental else 0.0)

    # ---- corners -----------------------------------------------------------------------------------------------

    def rounding(self, words: PathWords, number: int) -> None:
        """Execute RND: note the corner until its second line is known."""
        radius, feed = words.take("R"), words.take("F")
        last = self.motions[-1] if self.motions else None
        self._refuse_corner(words)
        if radius is None or radius <= 0.0:
            raise words.fault("RND needs a radius above zero", "R", "RND R5")
        if last is None or last.kind != "feed":
            raise words.fault("RND behind another motion than a straight feed", None, "Let the CAM system write arcs")
        state = self._state
        speed = last.feed_m_s if feed is None else feed * state.feed_unit_m / MINUTE
        if speed <= 0.0:
            raise words.fault("RND without a feed", "F")
        self.corner = (radius * state.unit_m, speed, number, words)

    def _refuse_corner(self, words: PathWords) -> None:
        if self.corner is not None:
            raise words.fault("RND before another motion than a straight feed", None, "Let the CAM system write arcs")

    def _round(self, words: PathWords, p_next: Float) -> None:
        """Cut the corner off the last motion and put the arc of RND behind it."""
        assert self.corner is not None
        radius, speed, number, rnd = self.corner
        self.corner = None
        state, last = self._state, self.motions[-1]
        a, b, c = (state.to_work(np.asarray(p)) for p in (last.p_start, last.p_end, p_next))
        if max(abs(a[2] - b[2]), abs(c[2] - b[2])) > _SAME_M:
            raise rnd.fault("the lines of RND do not lie in the working plane", None, "Let the CAM system write arcs")
        into, out = b - a, c - b
        sizes = float(np.linalg.norm(into)), float(np.linalg.norm(out))
        if min(sizes) < _SAME_M:
            raise rnd.fault("a line of RND has no length")
        into, out = into / sizes[0], out / sizes[1]
        turn = math.atan2(float(into[0] * out[1] - into[1] * out[0]), float(into @ out))
        if abs(turn) < _STRAIGHT or abs(turn) > math.pi - 1e-6:
            raise rnd.fault("the lines of RND make no corner", None, "Take RND out")
        cut = radius * math.tan(0.5 * abs(turn))
        if cut > min(sizes) + _SAME_M:
            raise rnd.fault("the radius of RND is too large for its lines", "R",
                            f"At most {min(sizes) / math.tan(0.5 * abs(turn)) / state.unit_m:.4f}")  # fmt: skip
        begin, end = b - cut * into, b + cut * out
        normal = math.copysign(radius, turn) * np.array([-into[1], into[0], 0.0])
        centre = state.to_part(begin + normal)
        p_begin = state.to_part(begin)
        p_begin.flags.writeable = False
        self.motions[-1] = replace(last, p_end=p_begin)
        state.p_part = p_begin
        sign = math.copysign(1.0, float(np.linalg.det(state.frames.A)))
        axis: Float = state.frames.A[:, 2] / float(np.linalg.norm(state.frames.A[:, 2]))
        if abs(float(np.diff(np.linalg.norm(state.frames.A[:, :2], axis=0))[0])) > 1e-9:
            raise words.fault("an arc under different scales of X and Y", None, "Cycle 26: the same factor for both")
        self._append(number, "arc", state.to_part(end), (speed, 0.0), arc=(centre, axis, sign * turn))

    # ---- cycles ------------------------------------------------------------------------------------------------

    def drill(self, words: PathWords, number: int, cycle: Drilling) -> None:
        """Execute a drilling cycle where the tool stands.

        Raises:
            ProgramError: It is not known where, or the tool is guided by M128.
        """
        self.require_place(words)
        self._refuse_corner(words)
        state = self._state
        self.require_axes(words, "a drilling cycle")
        if state.settle or state.tcpm:
            raise words.fault("a drilling cycle under M128, or before a motion behind cycle 8, 10 or 26", None,
                              "Go to the hole before, and end M128")  # fmt: skip
        for move in cycle.moves():
            if move.kind == "dwell":
                self._append(number, "dwell", state.p_part, duration_s=move.value)
                continue
            p_work = state.to_work(state.p_part)
            if abs(move.height_m - float(p_work[2])) < 1e-12:
                continue
            p_work[2] = move.height_m
            feed = (0.0, 0.0) if move.kind == "rapid" else (move.value * state.feed_unit_m / MINUTE, 0.0)
            self._append(number, "rapid" if move.kind == "rapid" else "feed", state.to_part(p_work), feed)
        state.polar_point = None
        state.motion = "G80"


def open_corner(maker: KlartextMoveMaker, name: str) -> ProgramError | None:
    """Return the error of an RND that no line follows; None where there is none."""
    if maker.corner is None:
        return None
    part: KlartextStatement = maker.corner[3].part
    return part.fault(name, "RND without a straight feed behind it", None, None, "Let the CAM system write arcs")
