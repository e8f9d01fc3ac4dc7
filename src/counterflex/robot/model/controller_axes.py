"""Map between the joint angles of the model and the axes that a robot controller shows.

The model is a serial chain: angle 3 is that between upper arm and forearm. A controller may count otherwise. With the
angles ``q`` of the model and the axes ``j`` of the controller (pendant, programs, telegrams, data sheet)::

    j = A q + z                                   A: signs, and the coupling of axis 3 to axis 2; z: zeros
    j3 = q3 + k (q2 - q2_upright)                 axis 3 counted from the horizontal, k = sign2 * sign3

:data:`MAKERS` finds for each maker the signs and zeros of its six-axis arms, whether axis 3 is counted from
the horizontal, and where the world frame of its controller lies. Lengths are those of
:class:`~counterflex.robot.model.description.Opw`; ``theta`` is zero where the arm stands upright.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float, frozen
from counterflex.core.errors import InputError
from counterflex.core.registry import Registry
from counterflex.core.units import DEG
from counterflex.geometry import rotation

Axis3 = Literal["upper_arm", "horizontal"]
_SAME_RAD: Final = 1e-6
_ROD_LIMIT_RAD: Final = -75.0 * DEG
"""Lower limit of axis 3 that tells ABB arms apart: -70 deg or above with a parallel rod, -100 or below without."""
_TURN: Final = 2.0 * math.pi
_NO_BETWEEN: Final = (
    "limits of axis 3 against the upper arm are not stated and not looked at: axis_3_to_upper_arm_deg in "
    "[robot.controller_axes]"
)


class Shape(Protocol):
    """Part of :class:`~counterflex.robot.model.description.Opw` that decides how axes are counted."""

    @property
    def signs(self) -> tuple[int, ...]:
        """Of the angles: ``theta = sign q - offset``."""

    @property
    def offsets_rad(self) -> tuple[float, ...]:
        """See ``signs``."""

    @property
    def c1_m(self) -> float:
        """Height of axis 2 above the base plate, m."""


@dataclass(frozen=True)
class Maker:
    """Convention of the six-axis arms of a maker."""

    title: str  # name for people
    language: str  # dialect of its programs
    signs: tuple[int, ...]  # of the axes against `theta`: `theta = sign j - offset`
    offsets_deg: tuple[float, ...]  # see `signs`
    axis_3: Axis3 | None  # what axis 3 is counted from; None where it depends on the arm
    # height of the origin of its world: `floor` is the base plate, `axis 2` that axis, both on axis 1
    world: Literal["floor", "axis 2"]
    source: str  # where the convention is stated
    letter: str = "axis "  # before the number of an axis
    # words of an orientation (3, 3) as the pendant shows them, with their unit; None: A B C
    words_of: Callable[[Float], dict[str, float]] | None = None
    set_up: str = ""  # file of the demonstration that sets up its link to the loop; empty: the cell file says all

    def __post_init__(self) -> None:
        if sorted({abs(sign) for sign in self.signs}) != [1] or len(self.signs) != 6 or len(self.offsets_deg) != 6:
            raise InputError("a maker has six signs, 1 or -1, and six offsets",
                             value=f"{self.signs} and {self.offsets_deg}")  # fmt: skip

    def orientation(self, R: Float) -> dict[str, float]:
        """Words of an orientation (3, 3) as the pendant shows them."""
        return turns_zyx(R) if self.words_of is None else self.words_of(R)


def turns_zyx(R: Float) -> dict[str, float]:
    """A B C of an orientation (3, 3): turns about z, y', x'', deg."""
    return dict(zip(("A deg", "B deg", "C deg"), rotation.to_zyx(R) / DEG, strict=True))


MAKERS: Final[Registry[Maker]] = Registry(
    "counterflex.controllers", "maker of robot controllers", "counterflex.robot.model.controller_axes:Maker"
)
"""Conventions by maker."""


@dataclass(frozen=True, eq=False)
class ControllerAxes:
    """The axes of a robot as its controller shows them."""

    maker: str | None = None  # of the controller; None where it is not known
    matrix: Float | None = None  # (6, 6) A of the module
    zero_rad: Float | None = None  # (6,) z of the module
    limits_rad: Float | None = None  # (6, 2) lower and upper limit of the controller's axes; None: those of the model
    world_m: float = 0.0  # height of the origin of the controller's world above the base plate, on axis 1
    assumed: str = ""  # what was taken without being said, one sentence; empty where nothing was
    axis_2_m: float = 0.0  # height of axis 2 above the base plate
    # the limits of the angle between upper arm and forearm are stated; they matter where axis 3 is counted from the
    # horizontal
    between_known: bool = False

    @property
    def coupled(self) -> bool:
        """True where an axis depends on two angles of the model."""
        return self.matrix is not None and bool(np.count_nonzero(self.matrix) > 6)

    @property
    def zero(self) -> Float:
        """(6,) rad, the controller's axes where all angles of the model are zero."""
        return np.zeros(6) if self.zero_rad is None else self.zero_rad

    def shown(self, q: Float) -> Float:
        """Axes of the controller. ``q`` (..., 6) rad of the model -> (..., 6) rad."""
        if self.matrix is None:
            return np.asarray(q, dtype=np.float64)
        out: Float = np.asarray(q, dtype=np.float64) @ self.matrix.T + self.zero
        return out

    def model(self, axes_rad: Float) -> Float:
        """Angles of the model; the inverse of :meth:`shown`."""
        if self.matrix is None:
            return np.asarray(axes_rad, dtype=np.float64)
        free = np.asarray(axes_rad, dtype=np.float64) - self.zero
        out: Float = free @ np.linalg.inv(self.matrix).T
        return out

    def shown_change(self, change: Float) -> Float:
        """Change, speed or acceleration of the controller's axes for that of the model. (..., 6) -> (..., 6)."""
        out: Float = np.asarray(change, dtype=np.float64) if self.matrix is None else np.asarray(change) @ self.matrix.T
        return out

    def model_change(self, change: Float) -> Float:
        """Change of the model's angles for that of the controller's axes; the inverse of :meth:`shown_change`."""
        if self.matrix is None:
            return np.asarray(change, dtype=np.float64)
        out: Float = np.asarray(change, dtype=np.float64) @ np.linalg.inv(self.matrix).T
        return out

    def in_world(self, T_base_a: Float) -> Float:
        """(..., 4, 4) m, a frame given in the base as the controller gives it, in its world."""
        out: Float = np.array(T_base_a, dtype=np.float64)
        out[..., 2, 3] -= self.world_m
        return out

    def model_limits(self, q3_limits_rad: Float | None = None) -> Float:
        """(6, 2) smallest box of the model's angles that holds every pose within the limits of the controller's axes.

        Args:
            q3_limits_rad: (2,) limits of the angle between upper arm and forearm, where they are known.
        """
        if self.limits_rad is None:
            raise InputError("the axes have no limits of their own")
        free = self.limits_rad - self.zero[:, None]
        back = np.eye(6) if self.matrix is None else np.linalg.inv(self.matrix)
        # Interval arithmetic: the box holds every allowed pose, and poses beyond a coupled axis, which room() tests.
        ends = back[:, :, None] * free[None, :, :]
        box = np.stack([ends.min(axis=2).sum(axis=1), ends.max(axis=2).sum(axis=1)], axis=1)
        if q3_limits_rad is not None:
            box[2] = [max(box[2, 0], q3_limits_rad[0]), min(box[2, 1], q3_limits_rad[1])]
        return frozen(box)


AS_MODEL: Final = ControllerAxes()
"""Axes that are the angles of the model, of a controller that is not known."""


def room(axes: ControllerAxes, joint_limits_rad: Float, q: Float) -> Float:
    """Distance of every axis from its nearer limit; negative outside.

    ``joint_limits_rad``: (6, 2) limits of the model's angles; ``q``: (..., 6) rad of the model.

    Returns:
        (..., 6) rad. Where axis 3 is coupled, the smaller of the distances of the controller's axis and of the angle
        between the arms.
    """
    own: Float = np.minimum(q - joint_limits_rad[:, 0], joint_limits_rad[:, 1] - q)
    if not axes.coupled or axes.limits_rad is None:
        return own
    shown = axes.shown(q)
    return np.minimum(own, np.minimum(shown - axes.limits_rad[:, 0], axes.limits_rad[:, 1] - shown))


def coupled_inside(axes: ControllerAxes, joint_limits_rad: Float, q: Float, margin_rad: float = 0.0) -> Bool:
    """(...,) True where the coupled axis 3 keeps its margin; always where axes are not coupled. ``q`` (..., 6) rad."""
    if not axes.coupled:
        return np.ones(np.shape(q)[:-1], dtype=np.bool_)
    out: Bool = room(axes, joint_limits_rad, q)[..., 2] >= margin_rad
    return out


def shown_limits(axes: ControllerAxes, joint_limits_rad: Float) -> Float:
    """(6, 2) limits as the controller states them, lower and upper, rad."""
    if axes.limits_rad is not None:
        return axes.limits_rad
    if axes.matrix is None:
        return joint_limits_rad
    return np.sort(axes.shown(joint_limits_rad.T).T, axis=1)


def maker_of(signs: tuple[int, ...], offsets_rad: tuple[float, ...]) -> str | None:
    """Maker whose arms have these signs and zeros; None where there is none."""
    for name, maker in MAKERS.items():
        off = np.array(offsets_rad) - np.array(maker.offsets_deg) * DEG
        if tuple(signs) == maker.signs and np.all(np.abs(off) < _SAME_RAD):
            return name
    return None


def from_geometry(
    maker: str,
    signs: tuple[int, ...],
    offsets_rad: tuple[float, ...],
    c1_m: float,
    axis_3: Axis3 | None = None,
    limits_rad: Float | None = None,
) -> ControllerAxes:
    """Axes that a maker's controller shows for an arm of known geometry, whatever signs and zeros describe the arm.

    Args:
        signs: Of the model's angles: ``theta = sign q - offset``.
        offsets_rad: See ``signs``.
        c1_m: Height of axis 2 above the base plate, m.
        axis_3: What axis 3 is counted from; None is the maker's rule.
        limits_rad: (6, 2) limits of the controller's axes, or None.
    """
    rule = MAKERS[maker]
    s, o = np.array(signs, dtype=np.float64), np.array(offsets_rad)
    sm, om = np.array(rule.signs, dtype=np.float64), np.array(rule.offsets_deg) * DEG
    assumed, counted = "", axis_3 or rule.axis_3
    if counted is None:
        counted = "upper_arm"
        assumed = (
            "axis 3 is taken to be counted from the upper arm, as ABB does for arms without a parallel rod; say "
            "robot.controller_axes.axis_3_from in the cell file"
        )
    C, upright = np.eye(6), np.zeros(6)
    if counted == "horizontal":
        C[2, 1] = sm[1] * sm[2]
        upright[2] = -C[2, 1] * sm[1] * om[1]
    matrix = C * (sm * s)[None, :]
    zero = C @ (sm * (om - o)) + upright
    return ControllerAxes(
        maker=maker,
        matrix=None if np.array_equal(matrix, np.eye(6)) and not np.any(np.abs(zero) > 0.0) else frozen(matrix),
        zero_rad=None if not np.any(np.abs(zero) > 0.0) else frozen(zero),
        limits_rad=None if limits_rad is None else frozen(as_float("limits of the axes", limits_rad, (6, 2))),
        world_m=c1_m if rule.world == "axis 2" else 0.0,
        assumed=assumed,
        axis_2_m=c1_m,
    )


def looks_rodded(limits_rad: Float) -> bool:
    """True where the range of axis 3 is that of an ABB arm with a parallel rod."""
    return bool(limits_rad[2, 0] > _ROD_LIMIT_RAD)


def wrapped(axes_rad: Float) -> Float:
    """Axes within half a turn. (..., 6) rad."""
    out: Float = axes_rad - _TURN * np.round(axes_rad / _TURN)
    return out


def from_signs(
    maker: str,
    signs: tuple[int, ...],
    zeros_rad: tuple[float, ...],
    axis_2_m: float,
    axis_3: Axis3 | None = None,
) -> ControllerAxes:
    """Axes of an arm whose model says only how its angles are counted: ``j = sign q + zero``, then the coupling.

    Args:
        signs: Of the controller's axes against the model's angles, +1 or -1.
        zeros_rad: Of the controller's axes where the model's angles are zero.
        axis_2_m: Height of axis 2 above the base plate, m.
        axis_3: See :func:`from_geometry`.
    """
    rule = MAKERS[maker]
    om = np.array(rule.offsets_deg) * DEG
    offsets = tuple(float(value) for value in om - np.array(rule.signs) * np.array(zeros_rad))
    model_signs = tuple(int(a * b) for a, b in zip(signs, rule.signs, strict=True))
    return from_geometry(maker, model_signs, offsets, axis_2_m, axis_3)


def in_language(
    axes: ControllerAxes, opw: Shape | None, limits_rad: Float, language: str, where: str
) -> tuple[ControllerAxes, tuple[str, ...]]:
    """Axes of a robot as a controller that runs programs of a language shows them.

    Args:
        opw: Its closed-form geometry, or None.
        limits_rad: (6, 2) limits of the model's angles.
        language: Dialect of the program.
        where: The cell file, for messages.

    Returns:
        The axes, and what was taken without being said, one sentence each. The world of a robot of another maker lies
        at axis 2 only where both makers have it there.

    Raises:
        InputError: Nothing says how the controller counts the axes of this robot, or no maker has the language.
    """
    maker = _maker_of_language(language, where)
    title = MAKERS[maker].title
    if axes.maker == maker:
        _check_rod(axes, limits_rad, where)
        open_limit = axes.coupled and not axes.between_known
        return axes, (*((axes.assumed,) if axes.assumed else ()), *((_NO_BETWEEN,) if open_limit else ()))
    if opw is None and axes.maker is None and axes.assumed:
        return from_signs(maker, (1,) * 6, (0.0,) * 6, axes.axis_2_m), (axes.assumed,)
    if opw is None or (axes.maker is None and axes.matrix is None and not opw_known(opw)):
        raise InputError(
            f"how the {title} controller counts the axes of this robot is not known",
            where=f"{where}: robot", value=f"maker {axes.maker or 'not said'}", limit=", ".join(MAKERS),
            hint=f'Say maker = "{maker}" in [robot.controller_axes], and signs and zeros_deg where they differ',
        )  # fmt: skip
    return _on_other_controller(axes, opw, maker)


def _maker_of_language(language: str, where: str) -> str:
    for name, one in MAKERS.items():
        if one.language == language:
            return name
    raise InputError(
        "no maker says how the controller of this language counts axes", where=where, value=language,
        hint=f'Register a Maker of the language "{language}" in counterflex.controllers',
    )  # fmt: skip


def _check_rod(axes: ControllerAxes, limits_rad: Float, where: str) -> None:
    """Refuse an arm that may have a parallel rod where nothing says what axis 3 is counted from."""
    if axes.assumed and looks_rodded(shown_limits(axes, limits_rad)):
        low, high = shown_limits(axes, limits_rad)[2] / DEG
        raise InputError(
            "axis 3 has the range of an arm with a parallel rod, and nothing says what it is counted from",
            where=f"{where}: robot", value=f"{low:g} to {high:g} deg", limit='"horizontal" or "upper_arm"',
            hint='Say axis_3_from in [robot.controller_axes]: "horizontal" for IRB 1400, 1410, 2400, 4400, 6400, '
            "6660, 8700",
        )  # fmt: skip


def _on_other_controller(axes: ControllerAxes, opw: Shape, maker: str) -> tuple[ControllerAxes, tuple[str, ...]]:
    title = MAKERS[maker].title
    remark = f"the robot is no {title}" if axes.maker else f"signs and zeros of the robot are not those of {title}"
    made = from_geometry(maker, opw.signs, opw.offsets_rad, opw.c1_m, MAKERS[maker].axis_3 or "upper_arm")
    high = MAKERS[maker].world == "axis 2"
    world_m = axes.world_m if high else 0.0
    plate = "; frames in its world are given from the base plate" if high and world_m == 0.0 else ""
    return replace(made, world_m=world_m), (
        f"{remark}: axes are those of an arm of this geometry on a controller of {title}{plate}",
    )


def opw_known(opw: Shape) -> bool:
    """True where signs and zeros of a geometry are those of a maker."""
    return maker_of(opw.signs, opw.offsets_rad) is not None
