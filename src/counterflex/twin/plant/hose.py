"""A hose pack between forearm and spindle: its pull and bending on the tool side of a flange sensor.

A hose clamped at both ends hangs between them: half of its weight rests on either clamp, it pulls along the chord once
that is longer than its slack length, and it resists being bent away from the directions in which it leaves the clamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.geometry.wrench import cross


@dataclass(frozen=True, eq=False)
class Hose:
    """A hose between two bodies.

    Attributes:
        p_arm_clamp: (3,) m, clamp on the forearm, in that body's frame.
        p_tool_clamp: (3,) m, clamp on the tool side, in that body's frame.
        tool_exit: (3,) unit vector in which the hose leaves the tool clamp, same frame.
        mass_kg: Of the hose.
        slack_m: Chord up to which it does not pull.
        pull_n_m: Stiffness beyond that.
        bending_nm: Moment at a right angle between exit and chord.
    """

    p_arm_clamp: Float
    p_tool_clamp: Float
    tool_exit: Float
    mass_kg: float = 2.5
    slack_m: float = 0.55
    pull_n_m: float = 45.0
    bending_nm: float = 4.0

    def on_tool(self, T_base_arm: Float, T_base_tool: Float, gravity_base: Float) -> tuple[Float, Float]:
        """What it does to the tool side.

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
