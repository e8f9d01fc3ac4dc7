"""Slow changes of a true cell while it works: a growing spindle, a drifting arm, tools, and the pull of a hose.

They are brought up to date every :data:`EVERY_S` of simulated time only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.geometry.pose import cross
from counterflex.twin.truth.other import HosePack
from counterflex.twin.truth.truth import Truth

# A hose pack between forearm and spindle: its pull and bending on the tool side of a flange sensor. A hose clamped at
# both ends hangs between them: half of its weight rests on either clamp, it pulls along the chord once that is longer
# than its slack length, and it resists being bent away from the directions in which it leaves the clamps.


@dataclass(frozen=True, eq=False)
class Hose:
    """A hose between two bodies."""

    p_arm_clamp: Float  # (3,) m, clamp on the forearm, in that body's frame
    p_tool_clamp: Float  # (3,) m, clamp on the tool side, in that body's frame
    tool_exit: Float  # (3,) unit vector in which the hose leaves the tool clamp, same frame
    mass_kg: float = 2.5  # of the hose
    slack_m: float = 0.55  # chord up to which it does not pull
    pull_n_m: float = 45.0  # stiffness beyond that
    bending_nm: float = 4.0  # moment at a right angle between exit and chord

    def on_tool(self, T_base_arm: Float, T_base_tool: Float, gravity_base: Float) -> tuple[Float, Float]:
        """Forces on the tool side.

        Args:
            T_base_arm: (4, 4) forearm.
            T_base_tool: (4, 4) body on the tool side.
            gravity_base: (3,) m/s2.

        Returns:
            Clamp position (3,) m and wrench (6,) N, N m about it, both in base axes.
        """
        far, near = pose.transform(T_base_arm, self.p_arm_clamp), pose.transform(T_base_tool, self.p_tool_clamp)
        chord = far - near
        length = float(np.linalg.norm(chord))
        along = chord / max(length, 1e-9)
        force = 0.5 * self.mass_kg * gravity_base + self.pull_n_m * max(0.0, length - self.slack_m) * along
        moment = self.bending_nm * cross(T_base_tool[:3, :3] @ self.tool_exit, along)
        return near, np.concatenate([force, moment])


EVERY_S: Final = 4.0e-3


def hose_of(pack: HosePack) -> Hose:
    """The hose of a truth."""
    return Hose(
        p_arm_clamp=np.array(pack.p_arm_clamp),
        p_tool_clamp=np.array(pack.p_tool_clamp),
        tool_exit=np.array([1.0, 0.0, 0.0]),
        mass_kg=pack.mass_kg,
        slack_m=pack.slack_m,
        pull_n_m=pack.pull_n_m,
        bending_nm=pack.bending_nm,
    )


class SlowChanges:
    """Moves the tool tip and the base of a plant and keeps the generalised forces of the hose.

    ``ends``: The tool tip in the last body and the first body in the base, (3,) m each, live: they are changed.
    ``body_pose``: Gives ``T_base_body`` (4, 4) of a body by name. ``push``: Adds the generalised forces of a wrench
    (6,) on a body about a point (3,), base axes, to an array (n,).

    Attributes:
        tool_growth_m: How much longer the tool in use is than the one that touched the part.
    """

    def __init__(
        self,
        truth: Truth,
        ends: tuple[Float, Float],
        body_pose: Callable[[str], Float],
        push: Callable[[str, Float, Float, Float], None],
    ) -> None:
        self._heat, self._gravity = truth.other.thermal, truth.gravity_base
        self._tip, self._base = ends
        self._tip_before, self._base_before = self._tip.copy(), self._base.copy()
        self._along: Float = np.array(truth.T_last_tcp[:3, 2])
        self._body_pose, self._push = body_pose, push
        self._pack, self._tool = truth.other.hose, truth.bodies[-1].name
        self._hose = None if self._pack is None else hose_of(self._pack)
        self.tool_growth_m = 0.0

    def update(self, since_touch_s: float) -> None:
        """Bring the ends to a time since the part was touched; they count from the next kinematics on."""
        grown = self.tool_growth_m
        if self._heat is not None:
            grown += self._heat.spindle_m * -math.expm1(-since_touch_s / self._heat.spindle_s)
            drift = -math.expm1(-since_touch_s / self._heat.arm_s)
            self._base[:] = self._base_before + drift * np.array(self._heat.arm_m)
        self._tip[:] = self._tip_before + grown * self._along

    def pull(self, force: Float) -> None:
        """Set ``force`` (n,) to the hose at the present kinematics: pull, bending, half its weight on each clamp."""
        force[:] = 0.0
        if self._pack is None or self._hose is None:
            return
        T_arm, T_tool = self._body_pose(self._pack.arm_body), self._body_pose(self._tool)
        place, w = self._hose.on_tool(T_arm, T_tool, self._gravity)
        weight = 0.5 * self._hose.mass_kg * self._gravity
        far = pose.transform(T_arm, self._hose.p_arm_clamp)
        moment = -w[3:] - cross(place - far, w[:3] - weight)
        self._push(self._tool, place, w, force)
        self._push(self._pack.arm_body, far, np.concatenate([2.0 * weight - w[:3], moment]), force)
