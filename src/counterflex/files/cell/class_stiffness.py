"""Robots of which stiffness, drives or play are not known: which axes that are, and what their class gives them.

Stiffness is given when it is asked for, drives, friction and play always: without them the planner would take drives as
rigid and friction as zero, which no robot has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import MM, MS, URAD
from counterflex.files.cell.robot import RobotTable
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.lowest_mode import assumed_masses, can_move
from counterflex.plan.modes import modes
from counterflex.robot.elasticity.chain import ElasticChain, rigid_axes
from counterflex.robot.model import catalog, class_prior
from counterflex.robot.model.class_prior import AXES, ClassPrior, DrivePrior, arm_over_axis
from counterflex.robot.model.description import Play, Robot

_ABOUT_Z = 5
_POSTURES = 32  # Within the joint limits; loop gains are set once for all postures. With 256 the gains differ by 3 %.
_TURNS = ("rx_urad_per_knm", "ry_urad_per_knm", "rz_urad_per_knm")


@dataclass(frozen=True)
class ClassStiffness:
    """Stiffness that a robot has been given by its class."""

    axes: tuple[int, ...]  # Numbers 0..5 of the axes that nothing was known of
    prior: ClassPrior

    @property
    def named(self) -> str:
        """The axes, for messages: ``A1, A2``."""
        return axis_names(self.axes)


@dataclass(frozen=True)
class ClassDrives:
    """Drives, friction and play that a robot is given by its class, axis by axis, where its cell file has none."""

    servo_axes: tuple[int, ...]  # Numbers 0..5 of the axes without loop gains
    play_axes: tuple[int, ...]  # Numbers 0..5 of the axes without play and friction
    whole_arm: tuple[int, ...]  # Numbers 0..5 of the axes whose spring stands for the whole arm
    prior: DrivePrior

    @property
    def loops(self) -> dict[str, tuple[list[float], float]]:
        """Values of keys of ``[[robot.servo]]`` by axis, and the factor that nine of ten robots lie within."""
        rows = [self.prior.servo(axis) for axis in self.servo_axes]
        return {
            "speed_gain_nm_s": ([row.speed_gain_nm_s for row in rows], class_prior.SPEED_GAIN_FACTOR),
            "position_gain_per_s": ([row.position_gain_per_s for row in rows], class_prior.POSITION_GAIN_FACTOR),
            "integral_time_ms": ([row.integral_time_s / MS for row in rows], class_prior.POSITION_GAIN_FACTOR),
            "friction_nm": ([row.friction_nm for row in rows], class_prior.FRICTION_FACTOR),
        }

    @property
    def lost(self) -> dict[str, tuple[list[float], float]]:
        """The same of ``[[robot.play]]``."""
        rows = [self._play(axis) for axis in self.play_axes]
        return {
            "dead_band_half_urad": ([row.half_band_rad / URAD for row in rows], class_prior.PLAY_FACTOR),
            "friction_nm": ([row.friction_nm[0] for row in rows], class_prior.FRICTION_FACTOR),
        }

    @property
    def shown(self) -> dict[str, Any]:
        """Plain values for a summary, in the keys of the cell file."""
        out: dict[str, Any] = {"from": "typical of the robot's class, scaled by lowest mode, payload and reach"}
        for name, axes, values in (("servo", self.servo_axes, self.loops), ("play", self.play_axes, self.lost)):
            shown = {key: [float(f"{one:.3g}") for one in value] for key, (value, _) in values.items()}
            factors = {key: factor for key, (_, factor) in values.items()}
            out[name] = {"axes": [axis + 1 for axis in axes], **shown, "factor_of_90_percent": factors} if axes else {}
        return out

    def given_to(self, chain: ElasticChain, *, servo: bool = True, play: bool = True) -> ElasticChain:
        """The chain with typical loop gains (``servo``), play and friction (``play``) where it has none."""
        loops, lost = list(chain.servo or (None,) * 6), list(chain.play or (None,) * 6)
        for axis in self.servo_axes if servo else ():
            loops[axis] = self.prior.servo(axis)
        for axis in self.play_axes if play else ():
            lost[axis] = self._play(axis)
        return replace(
            chain, servo=tuple(loops) if any(loops) else chain.servo, play=tuple(lost) if any(lost) else chain.play
        )

    def _play(self, axis: int) -> Play:
        return self.prior.play(axis, float(arm_over_axis()[axis]) if axis in self.whole_arm else 1.0)


def drives_of_class(
    chain: ElasticChain, robot: Robot, table: RobotTable, stiffness: ClassStiffness | None, *, loops: bool
) -> ClassDrives | None:
    """Return what the class of a robot says of drives and play that its cell file does not give; None: nothing.

    ``loops``: also loop gains. They follow the lowest mode, so the class gives none where stiffness is not known, and
    none beside a tap test, which holds robot and drives together.
    """
    servo, lost = (
        tuple(axis for axis in range(6) if known is None or known[axis] is None) for known in (chain.servo, chain.play)
    )
    servo = servo if loops and np.any(chain.compliance > 0.0) else ()
    if not (servo or lost):
        return None
    try:
        size = prior_of(robot, table)
    except InputError:
        return None
    whole = () if stiffness is None else stiffness.axes
    held = _held_mode(chain, robot) if servo else ()
    return ClassDrives(servo, lost, whole, DrivePrior(size.payload_kg, size.reach_m, *held))


def _held_mode(chain: ElasticChain, robot: Robot) -> tuple[float, float]:
    """Lowest mode, rad/s, and how far its drives yield, N m/rad, of :class:`DrivePrior`: medians over postures."""
    lower, upper = np.clip(robot.joint_limits_rad, -np.pi, np.pi).T
    pairs = []
    for q in np.random.default_rng(0).uniform(lower, upper, (_POSTURES, AXES)):
        M, stiffness = matrices(chain if can_move(chain) else assumed_masses(chain, q), q)[:2]
        free = modes(M, stiffness)
        yields = free.strain[:AXES, 0] * stiffness[:AXES] / class_prior.SPEED_GAIN_SHARE
        pairs.append((float(free.omega_rad_s[0]), float(np.sum(yields))))
    omega, nm = np.median(pairs, axis=0).tolist()
    return omega, nm


def axis_names(axes: tuple[int, ...]) -> str:
    """Axes 0..5 as a shop says them: ``A1, A2``."""
    return ", ".join(f"A{axis + 1}" for axis in axes)


def unknown_axes(robot: Robot, table: RobotTable) -> tuple[int, ...]:
    """Axes that have no stiffness, and of which the cell file does not say that they are rigid.

    Args:
        robot: With the cell file's changes to its elastic elements.
        table: Of the cell file: a row of ``[[robot.elastic]]`` that gives an axis a rotation, 0 included, states it.

    Returns:
        Numbers 0..5, rising.
    """
    stated = {row.segment for row in table.elastic if any(getattr(row, key) is not None for key in _TURNS)}
    axes = {segment.joint: segment.name for segment in robot.segments if segment.joint is not None}
    chain = ElasticChain.build(replace(robot, regions=(), curves=()))  # they may name bodies of the end effector
    return tuple(axis for axis in rigid_axes(chain) if axes[axis] not in stated)


def prior_of(robot: Robot, table: RobotTable) -> ClassPrior:
    """Return what the class of a robot says about its stiffness.

    Raises:
        InputError: Its payload is not known, or no robot of its size has a published stiffness.
    """
    payload, reach_mm = table.payload_kg, None
    if table.catalog is not None:
        entry = catalog.entry(table.catalog)
        payload, reach_mm = payload or entry.payload_kg, entry.reach_mm
    return class_prior.class_prior(payload, _reach_m(robot) if reach_mm is None else reach_mm * MM)


def _reach_m(robot: Robot) -> float:
    """Distance of the wrist centre from axis 1 with the arm stretched out; of other arms the lengths added up."""
    if robot.opw is not None:
        return robot.opw.a1_m + robot.opw.c2_m + float(np.hypot(robot.opw.a2_m, robot.opw.c3_m))
    return float(sum(np.linalg.norm(segment.T_prev_seg[:3, 3]) for segment in robot.segments[1:]))


def with_class_stiffness(robot: Robot, given: ClassStiffness) -> Robot:
    """The robot with the median of its class about the axes that nothing is known of."""
    segments = []
    for segment in robot.segments:
        if segment.joint in given.axes:
            compliance = np.array(segment.compliance)
            compliance[_ABOUT_Z] = 1.0 / given.prior.median_nm_per_rad[segment.joint]
            segments.append(replace(segment, compliance=compliance))
        else:
            segments.append(segment)
    return replace(robot, segments=tuple(segments))
