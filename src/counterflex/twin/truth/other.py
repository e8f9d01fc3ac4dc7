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
class BristleFriction:
    """Link-side friction of an axis with stiction, load and temperature, in place of its slip elements.

    The law and its sources: :mod:`counterflex.twin.plant.bristle_friction`.

    Attributes:
        axis: 0..5.
        coulomb_nm: Fc of the warm, unloaded joint.
        stiction_share: Friction at standstill over Fc, >= 1.
        stribeck_rad_s: v_s, speed of the link over which stiction vanishes.
        bristle_rad: Fc over the stiffness of the bristles.
        viscous_nm_s: N m per rad/s.
        load_nm: Torque of the gear that doubles the friction.
        cold_share: How much higher it is when the joint is cold, share.
        warming_s: Time constant of warming up.
    """

    axis: int
    coulomb_nm: float
    stiction_share: float
    stribeck_rad_s: float
    bristle_rad: float
    viscous_nm_s: float
    load_nm: float
    cold_share: float
    warming_s: float

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

    Attributes:
        bodies: The two bodies; the same twice for one.
        directions: (2,) 0..5 for ``tx ty tz rx ry rz``.
        share: Of the root of the product of the two stiffnesses.
        axis: 0..5 whose angle changes it, or None.
        phase_rad: Angle of that axis at which it is strongest.
    """

    bodies: tuple[str, str]
    directions: tuple[int, int]
    share: float
    axis: int | None = None
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.axis is not None:
            _axis("truth: coupling", self.axis)


@dataclass(frozen=True)
class Thermal:
    """Growth of the spindle and drift of the arm since the part was touched, ``end (1 - exp(-t / tau))`` each.

    Drift of pose is what ISO 9283 tests; growth along the axis is what a warming motor spindle does.

    Attributes:
        before_s: Time between touching the part and the start of the program.
        spindle_m: Growth along the tool in the end.
        spindle_s: Its time constant.
        arm_m: (3,) drift of the whole arm in the end, base axes.
        arm_s: Its time constant.
    """

    before_s: float
    spindle_m: float
    spindle_s: float
    arm_m: tuple[float, float, float]
    arm_s: float

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("truth thermal: before_s", self.before_s, zero=True)
        for name in ("spindle_s", "arm_s"):
            as_positive(f"truth thermal: {name}", getattr(self, name))


@dataclass(frozen=True)
class HosePack:
    """A hose pack that loads the arm while it works; the law: :mod:`counterflex.twin.plant.hose`.

    Attributes:
        arm_body: Body that holds its far clamp; the near one is on the last body.
        p_arm_clamp: (3,) m, in that body.
        p_tool_clamp: (3,) m, in the last body.
        mass_kg: Of the hoses between the clamps.
        slack_m: Chord beyond which it pulls.
        pull_n_m: Stiffness beyond that.
        bending_nm: Moment at a right angle between exit and chord.
    """

    arm_body: str
    p_arm_clamp: tuple[float, float, float]
    p_tool_clamp: tuple[float, float, float]
    mass_kg: float
    slack_m: float
    pull_n_m: float
    bending_nm: float

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("mass_kg", "slack_m", "pull_n_m", "bending_nm"):
            as_positive(f"truth hose: {name}", getattr(self, name), zero=True)


@dataclass(frozen=True)
class ToolOff:
    """How much a tool differs from what the tool table says.

    Attributes:
        number: Of the tool.
        length_m: Longer than the tool that touched the part, as far as the table does not know.
        diameter_m: Thicker than stated.
    """

    number: int
    length_m: float
    diameter_m: float


@dataclass(frozen=True)
class OtherPhysics:
    """All other kinds of a truth; the default has none.

    Attributes:
        gears: At most one for each axis; the others are straight.
        frictions: At most one for each axis; the others have slip elements.
        couplings: Any number, together less than the stiffness that they are added to.
        controller: None: it does what it was told.
        thermal: None: nothing grows.
        hose: None: none.
        tools: At most one for each number; the others are as stated.
    """

    gears: tuple[GearCurve, ...] = ()
    frictions: tuple[BristleFriction, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    controller: ControllerKind | None = None
    thermal: Thermal | None = None
    hose: HosePack | None = None
    tools: tuple[ToolOff, ...] = ()

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
        """How a tool is off; not at all where nothing is said of it."""
        return next((tool for tool in self.tools if tool.number == number), ToolOff(number, 0.0, 0.0))

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self != OtherPhysics()


def _axis(where: str, axis: int) -> None:
    if not 0 <= axis <= 5:
        raise ModelError(f"{where}: no such axis", value=axis + 1, limit="1 .. 6")
