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
    """

    axis: int  # 0..5
    torque_nm: tuple[float, float]  # (2,) at which the slope changes
    share: tuple[float, float, float]  # (3,) of the axis' stiffness
    hysteresis_nm: float  # of the unloaded gear
    hysteresis_share: float  # of the load
    hysteresis_rad: float  # wind-up over which the unloaded hysteresis builds up

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
    """Behaviour of the controller beside what it was told."""

    blending_share: float = 1.0  # distance at which it really begins to round a corner, over the one it was told
    # length of the moving mean over its axis references (a filter of finite impulse response behind the interpolation;
    # Biagiotti and Melchiorri 2008, Trajectory Planning for Automatic Machines and Robots)
    smoothing_s: float = 0.0
    dead_cycles: int = 0  # cycles more until a correction from outside is answered

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("blending_share", "smoothing_s", "dead_cycles"):
            as_positive(f"truth controller: {name}", getattr(self, name), zero=True)


@dataclass(frozen=True)
class BristleFriction:
    """Link-side friction of an axis with stiction, load and temperature, in place of its slip elements.

    The law and its sources: :mod:`counterflex.twin.plant.friction`.
    """

    axis: int  # 0..5
    coulomb_nm: float  # fc of the warm, unloaded joint
    stiction_share: float  # friction at standstill over Fc, >= 1
    stribeck_rad_s: float  # v_s, speed of the link over which stiction vanishes
    bristle_rad: float  # fc over the stiffness of the bristles
    viscous_nm_s: float  # N m per rad/s
    load_nm: float  # torque of the gear that doubles the friction
    cold_share: float  # how much higher it is when the joint is cold, share
    warming_s: float  # time constant of warming up

    def __post_init__(self) -> None:
        """Check ranges."""
        where = f"truth: friction of axis {self.axis + 1}"
        _axis(where, self.axis)
        for name in ("coulomb_nm", "stribeck_rad_s", "bristle_rad", "load_nm", "warming_s"):
            as_positive(f"{where}: {name}", getattr(self, name))
        for name in ("viscous_nm_s", "cold_share"):
            as_positive(f"{where}: {name}", getattr(self, name), zero=True)
        if self.stiction_share < 1.0:
            raise ModelError(f"{where}: stiction over Coulomb friction", value=self.stiction_share, limit=">= 1")


@dataclass(frozen=True)
class Coupling:
    """A spring between two elastic coordinates, or one's change with the posture.

    The law: :mod:`counterflex.twin.plant.other_forces`. Links and bearings have full stiffness matrices (Klimchik,
    Pashkevich and Chablat 2013, CAD-based approach for identification of elasto-static parameters of robotic
    manipulators). The torsions of gears have play and take no part.
    """

    bodies: tuple[str, str]  # the two bodies; the same twice for one
    directions: tuple[int, int]  # (2,) 0..5 for ``tx ty tz rx ry rz``
    share: float  # of the root of the product of the two stiffnesses
    axis: int | None = None  # 0..5 whose angle changes it, or None
    phase_rad: float = 0.0  # angle of that axis at which it is strongest

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.axis is not None:
            _axis("truth: coupling", self.axis)


@dataclass(frozen=True)
class Thermal:
    """Growth of the spindle and drift of the arm since the part was touched, ``end (1 - exp(-t / tau))`` each.

    Drift of pose is what ISO 9283 tests; growth along the axis is what a warming motor spindle does.
    """

    before_s: float  # time between touching the part and the start of the program
    spindle_m: float  # growth along the tool in the end
    spindle_s: float  # its time constant
    arm_m: tuple[float, float, float]  # (3,) drift of the whole arm in the end, base axes
    arm_s: float  # its time constant

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("truth thermal: before_s", self.before_s, zero=True)
        for name in ("spindle_s", "arm_s"):
            as_positive(f"truth thermal: {name}", getattr(self, name))


@dataclass(frozen=True)
class HosePack:
    """A hose pack that loads the arm while it works; the law: :mod:`counterflex.twin.plant.slow_changes`."""

    arm_body: str  # body that holds its far clamp; the near one is on the last body
    p_arm_clamp: tuple[float, float, float]  # (3,) m, in that body
    p_tool_clamp: tuple[float, float, float]  # (3,) m, in the last body
    mass_kg: float  # of the hoses between the clamps
    slack_m: float  # chord beyond which it pulls
    pull_n_m: float  # stiffness beyond that
    bending_nm: float  # moment at a right angle between exit and chord

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("mass_kg", "slack_m", "pull_n_m", "bending_nm"):
            as_positive(f"truth hose: {name}", getattr(self, name), zero=True)


@dataclass(frozen=True)
class ToolOff:
    """Difference of a tool from the tool table."""

    number: int  # of the tool
    length_m: float  # longer than the tool that touched the part, as far as the table does not know
    diameter_m: float  # thicker than stated


@dataclass(frozen=True)
class OtherPhysics:
    """All other kinds of a truth; the default has none."""

    gears: tuple[GearCurve, ...] = ()  # at most one for each axis; the others are straight
    frictions: tuple[BristleFriction, ...] = ()  # at most one for each axis; the others have slip elements
    couplings: tuple[Coupling, ...] = ()  # any number, together less than the stiffness that they are added to
    controller: ControllerKind | None = None  # none: it does what it was told
    thermal: Thermal | None = None  # none: nothing grows
    hose: HosePack | None = None
    tools: tuple[ToolOff, ...] = ()  # at most one for each number; the others are as stated

    def __post_init__(self) -> None:
        """Check that nothing is there twice, and that the couplings leave every spring stiff."""
        for what, ids in (
            ("gears", [gear.axis + 1 for gear in self.gears]),
            ("frictions", [friction.axis + 1 for friction in self.frictions]),
            ("tools", [tool.number for tool in self.tools]),
        ):
            if len(set(ids)) != len(ids):
                raise ModelError(f"{what} of the truth: twice the same", value=ids)
        total: dict[tuple[str, int], float] = {}
        for c in self.couplings:
            for end in set(zip(c.bodies, c.directions, strict=True)):
                total[end] = total.get(end, 0.0) + abs(c.share)
        for (body, direction), share in total.items():
            if share >= 1.0:
                raise ModelError(
                    "couplings of the truth: shares of one coordinate together",
                    where=f"{body}, {('tx', 'ty', 'tz', 'rx', 'ry', 'rz')[direction]}",
                    value=share,
                    limit="< 1",
                )

    def tool(self, number: int) -> ToolOff:
        """Deviations of a tool; zero where nothing is said of it."""
        return next((tool for tool in self.tools if tool.number == number), ToolOff(number, 0.0, 0.0))

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return self != OtherPhysics()


def _axis(where: str, axis: int) -> None:
    if not 0 <= axis <= 5:
        raise ModelError(f"{where}: no such axis", value=axis + 1, limit="1 .. 6")
