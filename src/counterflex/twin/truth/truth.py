"""True parameters of the simulated cell: bodies, drives, friction, cutting and stock.

The chain follows :mod:`counterflex.robot.model.description`: ``T_prev_next = T_prev_seg Rz(sign q + offset)
E(delta)``, with ``E`` a translation and then z-y'-x'' rotations. Two things are finer than there: the elastic
rotations turn about a bearing centre of their own, and bodies have inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive, frozen
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import Counterbalance, ElasticRegion
from counterflex.twin.truth.other import OtherPhysics

SLIP_ELEMENTS = 3


@dataclass(frozen=True)
class Body:
    """One rigid body with its drive and its elastic element in front of it."""

    name: str
    T_prev_seg: Float  # (4, 4) fixed pose in the previous body's frame (base for the first)
    joint: int | None  # driven axis 0..5 that turns this frame about its z, or None
    sign: float  # +1 or -1; ``theta = sign q + offset_rad``
    offset_rad: float  # see ``sign``
    compliance: Float  # (6,) ``tx ty tz rx ry rz`` m/N and rad/(N m) in this frame; 0 is rigid
    damping_s: float  # beta; every elastic coordinate has damping = beta times its stiffness
    p_seg_bearing: Float  # (3,) m, point in this frame that the elastic rotations turn about
    mass_kg: float
    p_seg_com: Float  # (3,) m, centre of gravity in this frame
    inertia_kg_m2: Float  # (6,) ``xx yy zz xy xz yz`` about the centre of gravity in axes of this frame

    def __post_init__(self) -> None:
        """Check shapes, ranges and that the inertia can belong to a rigid body."""
        where = f"truth body {self.name}"
        for name, shape in (
            ("T_prev_seg", (4, 4)),
            ("compliance", (6,)),
            ("p_seg_bearing", (3,)),
            ("p_seg_com", (3,)),
            ("inertia_kg_m2", (6,)),
        ):
            object.__setattr__(self, name, frozen(as_float(f"{where}: {name}", getattr(self, name), shape)))
        if self.sign not in (-1.0, 1.0):
            raise InputError("sign of a driven axis", where=where, value=self.sign, limit="+1 or -1")
        if np.any(self.compliance < 0.0):
            raise ModelError("negative compliance", where=where, value=self.compliance.min(), limit=">= 0")
        as_positive(f"{where}: damping_s", self.damping_s, zero=True)
        as_positive(f"{where}: mass_kg", self.mass_kg, zero=True)
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        principal = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        if principal[0] < 0.0 or principal[2] > (principal[0] + principal[1]) * (1.0 + 1e-9):
            raise ModelError("inertia that no rigid body has", where=where, value=principal.tolist())
        moving = self.joint is not None or bool(np.any(self.compliance > 0.0))
        if moving and (self.mass_kg == 0.0 or principal[0] <= 0.0):
            raise ModelError("a body that moves needs mass and inertia", where=where, value=self.mass_kg, limit="> 0")


@dataclass(frozen=True)
class Drive:
    """Servo, gear play and dry friction of one axis, in link-side units of the axis angle.

    The position loop P, the speed loop PI and full speed feed-forward are together a PID on the motor angle:
    ``kp = Kpv (Kv + 1/Ti)``, ``kv = Kpv``, ``ki = Kpv Kv / Ti`` with ``Kpv = speed_bandwidth inertia``.
    """

    rotor_inertia_kg_m2: float  # motor inertia reflected to the axis
    servo_inertia_kg_m2: float  # inertia the speed loop was tuned with
    speed_bandwidth_per_s: float
    position_gain_per_s: float
    integral_time_s: float
    dead_band_rad: float  # half width of the play in series with the torsion spring
    motor_friction_nm: float  # dry friction on the motor side
    motor_slip_rad: float  # displacement at which it yields
    link_friction_nm: tuple[float, ...]  # (3,) dry friction of the elements on the link side
    link_slip_rad: tuple[float, ...]  # (3,) displacements at which they yield
    # Kv of a drive that trails its reference by ``v / Kv``; None is full speed feed-forward
    following_gain_per_s: float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in (
            "rotor_inertia_kg_m2",
            "servo_inertia_kg_m2",
            "speed_bandwidth_per_s",
            "position_gain_per_s",
            "integral_time_s",
            "motor_slip_rad",
        ):
            as_positive(f"truth drive: {name}", getattr(self, name))
        for name in ("dead_band_rad", "motor_friction_nm"):
            as_positive(f"truth drive: {name}", getattr(self, name), zero=True)
        if len(self.link_friction_nm) != SLIP_ELEMENTS or len(self.link_slip_rad) != SLIP_ELEMENTS:
            raise InputError("link-side slip elements", value=len(self.link_friction_nm), limit=SLIP_ELEMENTS)
        for value in self.link_friction_nm:
            as_positive("truth drive: link_friction_nm", value, zero=True)
        for value in self.link_slip_rad:
            as_positive("truth drive: link_slip_rad", value)
        if self.following_gain_per_s is not None:
            as_positive("truth drive: following_gain_per_s", self.following_gain_per_s)


@dataclass(frozen=True)
class CuttingTruth:
    """Forces per length of edge: ``K h_ref^m h^(1-m) + edge (1 - exp(-h / edge_onset))`` for c, r and a.

    c is tangential against the cutting motion, r radial away from the edge into the tool, a axial towards the tool
    tip (what a right-handed helix on a clockwise tool feels). The linear-edge law is the case ``exponent = (0, 0, 0)``
    with its edge coefficients in ``edge_n_m``.
    """

    k_pa: tuple[float, float, float]  # (3,) specific forces c, r, a at the reference thickness
    exponent: tuple[float, float, float]  # (3,) m of c, r, a
    edge_n_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) ploughing force of the rounded edge per length
    edge_onset_m: float = 1.0e-6  # chip thickness at which ploughing sets in
    runout_m: float = 0.0  # offset of the tool axis from the axis it turns about
    h_ref_m: float = 1.0e-3  # reference chip thickness of ``k_pa``

    def __post_init__(self) -> None:
        """Check ranges."""
        for value in (*self.k_pa, *self.edge_n_m, self.runout_m):
            as_positive("truth cutting: force constant or runout", value, zero=True)
        for value in self.exponent:
            if not 0.0 <= value < 1.0:
                raise ModelError("truth cutting: exponent", value=value, limit="0 <= m < 1")
        as_positive("truth cutting: edge_onset_m", self.edge_onset_m)
        as_positive("truth cutting: h_ref_m", self.h_ref_m)


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """Place of the force sensor as stated when the cell is set up; a laboratory's seed turns it a little from there."""

    segment: str  # body that carries it
    T_seg_sensor: Float  # (4, 4) its frame in that body

    def __post_init__(self) -> None:
        """Check the shape."""
        frame = frozen(as_float("truth sensor: T_seg_sensor", self.T_seg_sensor, (4, 4)))
        object.__setattr__(self, "T_seg_sensor", frame)


@dataclass(frozen=True)
class Truth:
    """The whole simulated cell."""

    name: str
    bodies: tuple[Body, ...]  # from the base outward, robot and end effector in one chain
    T_last_tcp: Float  # (4, 4) tool tip in the last body's frame
    drives: tuple[Drive, ...]
    cutting: CuttingTruth  # force constants and runout
    seed: int | None = None  # seed that drew it, None for a nominal truth
    family: str = ""  # family that it was drawn from, empty for a nominal truth
    counterbalance: Counterbalance | None = None
    stock_top_offset_m: float = 0.0  # how much higher than stated the blank is
    gravity_base: Float = field(default_factory=lambda: np.array([0.0, 0.0, -STANDARD_GRAVITY]))  # (3,) m/s2
    # where the force sensor is said to sit; None: in the axes of the body that carries it
    sensor: SensorPlace | None = None
    # elastic coordinates that are other in other postures: a factor on the compliance over the motor angle of an axis,
    # linear between its angles, within 10 deg beyond them fading to 1
    regions: tuple[ElasticRegion, ...] = ()
    other: OtherPhysics = field(default_factory=OtherPhysics)  # Kinds of physics that no planner here has a model of

    def __post_init__(self) -> None:
        """Check the chain."""
        object.__setattr__(self, "T_last_tcp", frozen(as_float("truth: T_last_tcp", self.T_last_tcp, (4, 4))))
        object.__setattr__(self, "gravity_base", frozen(as_float("truth: gravity_base", self.gravity_base, (3,))))
        joints = [b.joint for b in self.bodies if b.joint is not None]
        if joints != [0, 1, 2, 3, 4, 5]:
            raise ModelError("driven axes of the truth", value=joints, limit="0..5, each once, in order")
        if len(self.drives) != 6:
            raise ModelError("drives of the truth", value=len(self.drives), limit=6)
        names = [b.name for b in self.bodies]
        if self.sensor is not None and self.sensor.segment not in names:
            raise ModelError("body of the truth's sensor", value=self.sensor.segment, limit=", ".join(names))
        self._check_other()
        for region in self.regions:
            if not self._is_spring(region.segment, region.direction):
                raise ModelError("elastic region of the truth: no such spring", value=region.segment)
            rising = bool(np.all(np.diff(region.angles_rad) > 0.0))
            if not rising or len(region.angles_rad) != len(region.factors) or min(region.factors) <= 0.0:
                raise ModelError(
                    "elastic region of the truth", where=region.segment, limit="rising angles, as many factors above 0"
                )

    def _check_other(self) -> None:
        driven = {b.name: b for b in self.bodies if b.joint is not None}
        torsions = [b.compliance[5] for b in driven.values()]
        for gear in self.other.gears:
            if torsions[gear.axis] == 0.0:
                raise ModelError("gear of the truth on an axis without torsion", value=f"axis {gear.axis + 1}")
        for coupling in self.other.couplings:
            for name, direction in zip(coupling.bodies, coupling.directions, strict=True):
                if not self._is_spring(name, direction):
                    raise ModelError("coupling of the truth: no such spring", value=name)
                if name in driven and direction == 5:  # within its play it has no stiffness to be shared
                    raise ModelError("coupling of the truth: the torsion of a gear", value=name, limit="another one")
        if self.other.hose is not None and self.other.hose.arm_body not in [b.name for b in self.bodies[:-1]]:
            raise ModelError("hose of the truth: no such body", value=self.other.hose.arm_body)

    def _is_spring(self, name: str, direction: int) -> bool:
        """Return whether a body yields in a direction 0..5."""
        body = next((b for b in self.bodies if b.name == name), None)
        return body is not None and bool(body.compliance[direction] != 0.0)

    def rigid_tcp(self, q: Float) -> Float:
        """Pose ``T_base_tcp`` (4, 4) of the undeformed chain at the axis angles ``q`` (6,) rad."""
        T = np.eye(4)
        for body in self.bodies:
            angle = body.offset_rad + (body.sign * float(q[body.joint]) if body.joint is not None else 0.0)
            T = T @ body.T_prev_seg @ pose.make(rotation.about_z(angle))
        out: Float = T @ self.T_last_tcp
        return out
