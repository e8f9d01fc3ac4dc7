"""The elastic robot in motion. The only module that touches the physics engine.

Each step takes the kinematics of the present state, adds drives, friction, play, cylinder and the process wrench as
applied forces, and lets MuJoCo integrate (``implicitfast``: elastic dampers implicit, no numerical damping). Where a
spring is too stiff for the step, the plant divides it: :mod:`.step_length`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError, SimulationError
from counterflex.geometry import pose
from counterflex.geometry.pose import cross
from counterflex.twin.plant.drives import gains
from counterflex.twin.plant.friction import play_torque, slip_parameters
from counterflex.twin.plant.loads import applied_forces, apply_loads, balance_parameters
from counterflex.twin.plant.mjcf import Coordinates, coordinates, model_xml, parts_of_step
from counterflex.twin.plant.other_forces import OtherForces, PostureSprings
from counterflex.twin.plant.slow_changes import SlowChanges
from counterflex.twin.truth.truth import Truth

STEP_S = 0.5e-3
mujoco.set_mju_user_warning(lambda _: None)  # Plant.check raises; the engine would write a log into the working folder
_FIRST_BODY = 1  # the engine's body 0 is the world
_FLOAT_NM = 1.0  # a link with less load than this floats within its play, held by dry friction
_SETTLED = 1e-13  # rad or m, change of an elastic coordinate at which the equilibrium has been found
_ROUNDS = 200


class Plant:
    """One elastic robot cell, stepped in time.

    ``step_s``: Time from one call of :meth:`step` to the next, s; 0.5 ms resolves all modes that matter. ``friction``:
    False leaves out dry friction and play (for comparison with closed forms). ``parts``: Integration steps in a step;
    None divides it as finely as its stiffest spring asks for.

    Attributes:
        time_s: Time since the last reset, s.
        coordinates: What each coordinate is.
        drive_torque: (6,) N m, last drive torques.
        parts: Integration steps in a step.
        q_ref: (6,) rad, last reference of the drives.
        load: (6,) N, N m, last wrench on the tool about the tip, base axes.
    """

    def __init__(
        self, truth: Truth, *, step_s: float = STEP_S, friction: bool = True, parts: int | None = None
    ) -> None:
        self.truth = truth
        self.step_s = as_positive("step_s", step_s)
        self.coordinates: Coordinates = coordinates(truth)
        try:
            self._model = mujoco.MjModel.from_xml_string(model_xml(truth, self.step_s))
        except ValueError as fault:
            raise SimulationError("the physics engine refuses the truth", value=str(fault)) from fault
        self._data = mujoco.MjData(self._model)
        if self._model.nv != len(self.coordinates.kind):
            raise SimulationError("coordinates of model and truth", value=self._model.nv)
        self.time_s = 0.0
        self.drive_torque: Float = np.zeros(6)
        c, d = self.coordinates, self._data
        self._hinge: Bool = np.array((c.kind < 0) | (c.kind >= 3))
        self._elastic: Bool = np.array(c.kind >= 0)
        driven = [b for b in truth.bodies if b.joint is not None]
        self._sign: Float = np.array([b.sign for b in driven])
        self._springs = PostureSprings(truth, c)
        self._stiffness: Float = c.stiffness.copy()
        self._torsion_stiffness: Float = np.where(c.torsion >= 0, c.stiffness[c.torsion], 0.0)
        self._band: Float = np.array([x.dead_band_rad if friction else 0.0 for x in truth.drives])
        self._slip_stiffness, self._slip_limit = slip_parameters(truth.drives)
        if not friction:
            self._slip_stiffness, self._slip_limit = np.zeros((6, 4)), np.zeros((6, 4))
        self._slip_force: Float = np.zeros((6, 4))
        self._slip_angle: Float = np.zeros((6, 2))
        self._pid = gains(truth.drives)
        self._integral: Float = np.zeros(6)
        self._balance = balance_parameters(truth.counterbalance)
        site = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_SITE, "tcp")
        self._p: Float = d.site_xpos[site]
        self._R: Float = d.site_xmat[site].reshape(3, 3)
        self._qpos: Float = d.qpos
        self._qvel: Float = d.qvel
        self._force: Float = d.qfrc_applied
        self._warnings: Int = d.warning.number
        self._anchor: Float = d.xanchor
        self._axis: Float = d.xaxis
        self._speed_before: Float = np.zeros(self._model.nv)
        self.load: Float = np.zeros(6)
        self.q_ref: Float = np.zeros(6)
        self._body_id = _body_ids(self._model, truth)
        self._reference: Float = np.zeros(6)
        self._more = self._other_forces(site, friction) if truth.other else None
        self.parts = self._parts() if parts is None else parts
        self._part_s = self.step_s / self.parts
        self._model.opt.timestep = self._part_s
        if self._more is not None:
            self._more.step_of(self._part_s)
        self.reset(np.zeros(6))

    def _other_forces(self, site: int, friction: bool) -> OtherForces:
        ends = self._model.site_pos[site], self._model.body_pos[_FIRST_BODY]  # live views
        more = OtherForces(
            self.truth,
            self.coordinates,
            SlowChanges(self.truth, ends, self._body_pose, self._push),
            sign=self._sign,
            stiffness=self._torsion_stiffness,
            half_band=self._band,
            friction=friction,
        )
        for elements in (self._slip_stiffness, self._slip_limit):
            elements[more.replaced, :-1] = 0.0
        return more

    def _parts(self) -> int:
        c = self.coordinates
        gears, bristles, viscous = self._more.stiffest() if self._more is not None else np.zeros((3, 6))
        sprung, stuck = c.torsion >= 0, self._slip_stiffness[:, :-1].sum(axis=1) + bristles
        on_motor = self._slip_stiffness[:, -1] + self._pid[:, 0]
        K = np.diag(self._springs.stiffest) + c.on_axes(self._sign, stuck, on_motor)
        K[c.torsion[sprung], c.torsion[sprung]] += gears[sprung]
        drag = c.on_axes(self._sign, viscous, self._pid[:, 1])
        return parts_of_step(self._inertia_at, K, np.diag(self._model.dof_damping), drag, self.step_s)

    def _inertia_at(self, q: Float) -> Float:
        """(n, n) inertia at motor angles (6,) rad, unloaded."""
        self._qpos[:] = 0.0
        self._qpos[self.coordinates.motor] = q
        mujoco.mj_forward(self._model, self._data)
        return self.mass_matrix()

    def program_time(self, time_s: float, tool: int) -> None:
        """Say how long the program has run and with which tool; until then the part is just being touched."""
        if self._more is not None:
            self._more.program_time(time_s, self.truth.other.tool(tool).length_m)

    def equilibrium(self, q: Float, w_tcp_base: Float | None = None) -> Float:
        """Static equilibrium with the motors held: pose of the tool tip.

        Moves the plant's state there, like :meth:`reset`.

        Args:
            q: (6,) rad motor angles.
            w_tcp_base: (6,) N, N m on the tool about the tip in base axes; None is no load but its own weight.

        Returns:
            ``T_base_tcp`` (4, 4).

        Raises:
            SimulationError: The chain finds no equilibrium (it buckles or a number is not finite).
        """
        self.reset(q, w_tcp_base)
        return self.tcp_pose()

    def reset(self, q: Float, w_tcp_base: Float | None = None, qd: Float | None = None) -> None:
        """Start from the exact static equilibrium: slip elements relaxed, integrators hold the load.

        Args:
            q: (6,) rad motor angles.
            w_tcp_base: (6,) load on the tool, see :meth:`equilibrium`.
            qd: (6,) rad/s motor speeds to start with; None is at rest.

        Raises:
            SimulationError: No equilibrium is found.
        """
        q = as_float("q", q, (6,))
        load = np.zeros(6) if w_tcp_base is None else as_float("w_tcp_base", w_tcp_base, (6,))
        c = self.coordinates
        mujoco.mj_resetData(self._model, self._data)
        self._qpos[c.motor] = q
        if self._springs:
            self._take_posture()
        dry = np.sum(self._slip_limit[:, :-1], axis=1)
        if self._more is not None:
            dry += self._more.dry
            self._more.start()
        net = self._settle(q, load, dry)
        held = self._hold_by_stiction(net, dry)
        self._integral[:] = -net[c.motor] - np.sum(self._slip_force[:, :-1], axis=1)
        link = q + np.where(c.torsion >= 0, self._sign * self._qpos[c.torsion], 0.0)
        self._slip_angle[:, 0], self._slip_angle[:, 1] = link, q
        if qd is not None:
            self._qvel[c.motor] = as_float("qd", qd, (6,))
        if self._more is not None:
            held[~self._more.replaced] = 0.0
            self._integral -= held
            self._more.rest(self._qpos, held)
        self.drive_torque[:] = self._integral
        self.time_s = 0.0
        self.load[:], self.q_ref[:] = load, q
        self._speed_before[:] = self._qvel
        mujoco.mj_step1(self._model, self._data)

    def _settle(self, q: Float, load: Float, dry: Float) -> Float:
        """Move the elastic coordinates into equilibrium with the load; the forces on all coordinates there."""
        c, d = self.coordinates, self._data
        band, floating = np.zeros(len(c.kind)), np.ones(len(c.kind))
        sprung = np.flatnonzero(c.torsion >= 0)
        band[c.torsion[sprung]] = self._band[sprung]
        floating[c.torsion[sprung]] = np.clip(0.5 * dry, 1e-6, _FLOAT_NM)[sprung]
        soft = self._elastic
        applied: Float = np.zeros(len(c.kind))
        straight: Float = np.zeros(len(c.kind))
        for _ in range(_ROUNDS):
            mujoco.mj_forward(self._model, d)
            applied[:] = 0.0
            apply_loads(
                self._qpos, self._anchor, self._axis, self._hinge, c.motor, c.torsion, self._sign, self._p, load,
                self._balance, applied,
            )  # fmt: skip
            if self._more is not None:
                self._more.follow()
                self._more.resting(self._qpos, applied)
            net: Float = applied - d.qfrc_bias
            straight[soft] = net[soft] / self._stiffness[soft]
            if self._more is not None:
                self._more.bend(straight, net)
            target = straight[soft] + np.clip(net[soft] / floating[soft], -1.0, 1.0) * band[soft]
            change = float(np.max(np.abs(target - self._qpos[soft]), initial=0.0))
            if not np.isfinite(change) or change > 1.0:
                break
            self._qpos[soft] = target
            if change < _SETTLED:
                return net
        raise SimulationError(
            "the elastic chain finds no static equilibrium",
            value=f"joints {np.round(np.degrees(q), 3).tolist()} deg",
            hint="Check masses and compliances of the truth",
        )

    def _hold_by_stiction(self, net: Float, dry: Float) -> Float:
        """Set the slip elements to hold what the play leaves unsupported; (6,) N m that other friction holds."""
        self._slip_force[:] = 0.0
        held: Float = np.zeros(6)
        for i in np.flatnonzero(self.coordinates.torsion >= 0):
            t = self.coordinates.torsion[i]
            spring = play_torque(self._qpos[t], self._torsion_stiffness[i], self._band[i])
            if self._more is not None:
                spring = self._more.spring(int(i), self._qpos[t], spring)
            if dry[i] > 0.0:
                self._slip_force[i, :-1] = -self._sign[i] * (net[t] + spring) * self._slip_limit[i, :-1] / dry[i]
                held[i] = -self._sign[i] * (net[t] + spring) - np.sum(self._slip_force[i, :-1])
        return held

    def step(self, q_ref: Float, qd_ref: Float, w_tcp_base: Float) -> None:
        """Advance one step; afterwards the kinematics belong to the new time.

        Args:
            q_ref: (6,) rad, float64, C order: reference of the drives now.
            qd_ref: (6,) rad/s.
            w_tcp_base: (6,) N, N m on the tool about the tip in base axes, acting during the step.
        """
        if self._springs:
            self._take_posture()
        self.load[:], self.q_ref[:], self._speed_before[:] = w_tcp_base, q_ref, self._qvel
        self._reference[:] = q_ref
        for _ in range(self.parts):
            self._step_part(qd_ref, w_tcp_base)
            self._reference += self._part_s * qd_ref
        self.time_s += self.step_s

    def _step_part(self, qd_ref: Float, w_tcp_base: Float) -> None:
        c = self.coordinates
        applied_forces(
            self._qpos, self._qvel, self._anchor, self._axis, self._hinge, c.motor, c.torsion, self._sign, self._p,
            w_tcp_base, self._balance, self._torsion_stiffness, self._band, self._slip_stiffness, self._slip_limit,
            self._slip_force, self._slip_angle, self._reference, qd_ref, self._pid, self._integral, self._part_s,
            self._force, self.drive_torque,
        )  # fmt: skip
        if self._more is not None:
            self._more.apply(self._qpos, self._qvel, self._force)
        mujoco.mj_step2(self._model, self._data)
        mujoco.mj_step1(self._model, self._data)

    def _take_posture(self) -> None:
        """Give the springs the stiffness of the present motor angles."""
        c, free = self.coordinates, self._springs.free
        self._stiffness[:] = self._springs.stiffness(self._qpos[c.motor])
        self._model.jnt_stiffness[free] = self._stiffness[free]
        self._torsion_stiffness[:] = np.where(c.torsion >= 0, self._stiffness[c.torsion], 0.0)

    def check(self) -> None:
        """Raise if the simulation has left its physical range since the last reset.

        Raises SimulationError: a coordinate is not finite or the engine warned.
        """
        if not np.all(np.isfinite(self._qpos)) or self._warnings.any():
            raise SimulationError(
                "the simulated robot became unstable",
                where=f"{self.time_s:.4f} s after the start of this stretch",
                hint="Check forces, drive gains and masses of the truth",
            )

    @property
    def p_base_tcp(self) -> Float:
        """(3,) m, live view of the tool tip's position."""
        return self._p

    @property
    def R_base_tcp(self) -> Float:
        """(3, 3), live view of the tool's axes."""
        return self._R

    def tcp_pose(self) -> Float:
        """``T_base_tcp`` (4, 4) now."""
        return pose.make(self._R, self._p)

    def body_pose(self, name: str) -> Float:
        """``T_base_body`` (4, 4) now, of the frame behind a body's drive and elastic element.

        Raises InputError: there is no such body.
        """
        return self._body_pose(name)

    def _body_pose(self, name: str) -> Float:
        i = self._body_of(name)
        return pose.make(np.array(self._data.xmat[i]).reshape(3, 3), np.array(self._data.xpos[i]))

    def _push(self, name: str, p_base: Float, w_base: Float, force: Float) -> None:
        """Add the generalised forces of a wrench (6,) on a body about a point (3,), base axes, to ``force`` (n,)."""
        body = self._body_of(name)
        mujoco.mj_applyFT(self._model, self._data, w_base[:3], w_base[3:], p_base, body, force)

    def section_wrench(self, name: str) -> Float:
        """Load on a body and all that hangs behind it, as it passes through the section in front of the body.

        ``w = w_process + sum m g - d(momentum)/dt``, taken about the origin of the body's frame in its axes: what a
        force sensor whose tool side is this body shows, weight and inertia included. Inertia is that of the last step
        (none right after :meth:`reset`). Returns (6,) N, N m. Raises InputError: there is no such body.
        """
        i, d = self._body_of(name), self._data
        qacc = d.qacc.copy()
        d.qacc[:] = (self._qvel - self._speed_before) / self.step_s
        mujoco.mj_rnePostConstraint(self._model, d)
        d.qacc[:] = qacc
        moment, force = -d.cfrc_int[i, :3], -d.cfrc_int[i, 3:]  # about the tree's centre of gravity, base axes
        origin: Float = np.array(d.xpos[i])
        moment = moment + cross(d.subtree_com[self._model.body_rootid[i]] - origin, force)
        force = force + self.load[:3]
        moment = moment + self.load[3:] + cross(self._p - origin, self.load[:3])
        R = np.array(d.xmat[i]).reshape(3, 3)
        return np.concatenate([R.T @ force, R.T @ moment])

    def _body_of(self, name: str) -> int:
        if name not in self._body_id:
            raise InputError("the truth has no such body", value=name, limit=", ".join(self._body_id))
        return self._body_id[name]

    def q_motor(self) -> Float:
        """(6,) rad, motor angles: what the robot controller reads."""
        out: Float = self._qpos[self.coordinates.motor]
        return out

    def q_link(self) -> Float:
        """(6,) rad, motor angle plus torsion of each axis."""
        c = self.coordinates
        out: Float = self.q_motor() + np.where(c.torsion >= 0, self._sign * self._qpos[c.torsion], 0.0)
        return out

    def mass_matrix(self) -> Float:
        """(n, n) inertia of the present state, rotor inertias included."""
        n = self._model.nv
        out: Float = np.empty((n, n))
        column, unit = np.zeros((1, n)), np.eye(n)
        for i in range(n):
            mujoco.mj_mulM(self._model, self._data, column[0], unit[i])
            out[:, i] = column[0]
        return out

    def bias(self) -> Float:
        """(n,) gravity, centrifugal and Coriolis forces of the present state."""
        return np.array(self._data.qfrc_bias)

    def state(self) -> tuple[Float, Float]:
        """Copies of coordinates (n,) and speeds (n,)."""
        return np.array(self._qpos), np.array(self._qvel)


def _body_ids(model: mujoco.MjModel, truth: Truth) -> dict[str, int]:
    """Number of each body in the engine: the part behind its drive where the drive has a carrier of its own."""
    out = {}
    for index, body in enumerate(truth.bodies):
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"b{index}e")
        out[body.name] = number if number >= 0 else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"b{index}")
    return out
