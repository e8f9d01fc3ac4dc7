"""Other kinds of physics that a true cell may have and that no planner here has a model of, each one to be left out.

What is empty or None is absent; a truth without any is stepped exactly as before there were other kinds.
"""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import as_positive
from counterflex.core.errors import ModelError


@dataclass(frozen=True)
class GearCurve:
    """Torque of a gear over its wind-up: three straight parts, and hysteresis that grows with the load.

    With k the axis' stiffness (of the body's ``rz``) and x the wind-up beyond the dead band, the torque rises with
    ``share_1 k`` up to ``torque_1``, with ``share_2 k`` up to ``torque_2`` and with ``share_3 k`` beyond. In parallel
    acts a Maxwell slip element on the wind-up that holds at most ``hysteresis_nm + hysteresis_share |torque|``.

    The form is that of the data sheets of strain wave gears (Harmonic Drive, engineering data: K1 up to T1, K2 up to
    T2, K3 beyond) and, with a small ``torque_1``, of cycloidal gears (Nabtesco RV, rating table: lost motion at 3 % of
    the rated torque, hysteresis loss, stiffness between half and full rated torque).

    Attributes:
        axis: 0..5.
        torque_nm: (2,) at which the slope changes.
        share: (3,) of the axis' stiffness.
        hysteresis_nm: Of the unloaded gear.
        hysteresis_share: Of the load.
        hysteresis_rad: Wind-up over which the unloaded hysteresis builds up.
    """

    axis: int
    torque_nm: tuple[float, float]
    share: tuple[float, float, float]
    hysteresis_nm: float
    hysteresis_share: float
    hysteresis_rad: float

    def __post_init__(self) -> None:
        """Check ranges."""
        where = f"truth: gear of axis {self.axis + 1}"
        _axis(where, self.axis)
        for value in (*self.torque_nm, *self.share, self.hysteresis_rad):
            as_positive(where, value)
        for value in (self.hysteresis_nm, self.hysteresis_share):
            as_positive(where, value, zero=True)
        if self.torque_nm[1] <= self.torque_nm[0]:
            raise ModelError(f"{where}: torques at which the slope changes", value=self.torque_nm, limit="rising")
        if self.hysteresis_share >= 1.0:
            raise ModelError(f"{where}: hysteresis as a share of the load", value=self.hysteresis_share, limit="< 1")


@dataclass(frozen=True)
class ControllerKind:
    """What the controller makes of a program beside what it was told.

    Attributes:
        blending_share: Distance at which it really begins to round a corner, over the one it was told.
        smoothing_s: Length of the moving mean over its axis references (a filter of finite impulse response behind the
            interpolation; Biagiotti and Melchiorri 2008, Trajectory Planning for Automatic Machines and Robots).
        dead_cycles: Cycles more until a correction from outside is answered.
    """

    blending_share: float = 1.0
    smoothing_s: float = 0.0
    dead_cycles: int = 0

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("blending_share", "smoothing_s", "dead_cycles"):
            as_positive(f"truth controller: {name}", getattr(self, name), zero=True)


@dataclass(frozen=True)
class OtherPhysics:
    """All other kinds of a truth; the default has none.

    Attributes:
        gears: At most one for each axis; the others are straight.
        controller: None: it does what it was told.
    """

    gears: tuple[GearCurve, ...] = ()
    controller: ControllerKind | None = None

    def __post_init__(self) -> None:
        """Check that no axis has two gears."""
        axes = [gear.axis for gear in self.gears]
        if len(set(axes)) != len(axes):
            raise ModelError("gears of the truth", value=[axis + 1 for axis in axes], limit="one for each axis")

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self != OtherPhysics()


def _axis(where: str, axis: int) -> None:
    if not 0 <= axis <= 5:
        raise ModelError(f"{where}: no such axis", value=axis + 1, limit="1 .. 6")
