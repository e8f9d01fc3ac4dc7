"""Pose of a robot's tool for joint angles, and joint angles for a pose; no cell is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.kinematics import inverse
from counterflex.robot.model import catalog
from counterflex.robot.model.controller_axes import room, shown_limits

_ROUNDING_RAD: Final = 1e-9


def chain_of(robot_or_cell: str) -> ElasticChain:
    """The elastic chain of a cell file, or of a bare catalogue robot whose TCP is its flange."""
    if Path(robot_or_cell).suffix == ".toml" or Path(robot_or_cell).is_file():
        from counterflex.files.cell.cell import read_cell  # half a second, which a bare robot does not need

        return read_cell(robot_or_cell).chain
    return ElasticChain.build(catalog.load(robot_or_cell))


class PoseOfJoints(Summary):
    """Pose of the tool centre point."""

    def _shown(self) -> Parts:
        for title, key, form in (
            (f"TCP of {self.name} in its base", "tcp_in_base", ".4f"),
            ("Margin to the joint limits, deg", "margins", ".2f"),
        ):
            yield ShownTable(title, list(self[key]), [[format(value, form) for value in self[key].values()]])

    def __init__(self, name: str, values: dict[str, Any]) -> None:
        super().__init__(values)
        self.name = name


class JointsOfPose(PoseOfJoints):
    """Joint angles of every branch that reaches a pose."""

    def _shown(self) -> Parts:
        yield ShownTable.of(
            f"{len(self['solutions'])} ways for {self.name} to be there",
            f"branch | {''.join(f'A{i + 1} deg=joints_deg[{i}]:.4f | ' for i in range(6))}"
            "smallest margin deg=least:.2f | wrist deg:.2f",
            [one | {"least": min(one["margins"].values())} for one in self["solutions"]],
            "wrist: how far axis 5 is from the wrist singularity.",
        )


def pose_of_joints(chain: ElasticChain, joints_deg: list[float]) -> PoseOfJoints:
    """TCP pose in the base for joint angles, with the margin to every joint limit."""
    q = checked_joints(chain, joints_deg)
    tcp = pose_mm_deg(forward(chain, q))
    margins = joint_margins(chain, q)
    return PoseOfJoints(chain.name, {"tcp_in_base": tcp, "joints_deg": list(joints_deg), "margins": margins})


def joints_of_pose(chain: ElasticChain, xyz_mm: list[float], abc_deg: list[float]) -> JointsOfPose:
    """All joint angles that bring the TCP to a pose, branch by branch.

    Raises:
        ReachError: No branch reaches the pose within the joint limits.
    """
    T_base_tcp = pose.from_xyz_zyx(as_float("--xyz-mm", xyz_mm, (3,)) * MM, as_float("--abc-deg", abc_deg, (3,)) * DEG)
    values = {
        "tcp_in_base": pose_mm_deg(T_base_tcp),
        "solutions": [
            {
                "branch": str(solution.branch),
                "joints_deg": rounded(chain.axes.shown(solution.q) / DEG, 6),
                "margins": joint_margins(chain, solution.q),
                "wrist_deg": round(float(np.arcsin(min(1.0, solution.wrist)) / DEG), 3),
            }
            for solution in inverse.inverse_all(chain, T_base_tcp)
        ],
    }
    return JointsOfPose(chain.name, values)


def checked_joints(chain: ElasticChain, joints_deg: list[float]) -> Float:
    """Angles of the model, rad, for axes as the controller shows them. Raises InputError: one is outside its limits."""
    shown: Float = as_float("--joints-deg", joints_deg, (6,)) * DEG
    low, high = shown_limits(chain.axes, chain.joint_limits_rad).T
    outside = (shown < low) | (shown > high)
    if np.any(outside):
        axis = int(np.argmax(outside))
        raise InputError(
            f"axis {axis + 1} of {chain.name} is outside its joint limits",
            where="--joints-deg",
            value=f"{joints_deg[axis]:g} deg",
            limit=f"{low[axis] / DEG:g} to {high[axis] / DEG:g} deg",
        )
    q = chain.axes.model(shown)
    beyond = (q < chain.joint_limits_rad[:, 0] - _ROUNDING_RAD) | (q > chain.joint_limits_rad[:, 1] + _ROUNDING_RAD)
    if np.any(beyond):
        axis = int(np.argmax(beyond))
        least, most = chain.joint_limits_rad[axis] / DEG
        raise InputError(
            f"axis {axis + 1} of {chain.name} is outside its limits against the upper arm",
            where="--joints-deg",
            value=f"{q[axis] / DEG:g} deg",
            limit=f"{least:g} to {most:g} deg",
        )
    return q


def joint_margins(chain: ElasticChain, q: Float) -> dict[str, float]:
    """Distance of every joint from its nearer limit, deg, by axis."""
    margin = room(chain.axes, chain.joint_limits_rad, q) / DEG
    return {f"axis{i + 1}": round(float(value), 3) for i, value in enumerate(margin)}


def pose_mm_deg(T: Float) -> dict[str, float]:
    """A pose in shop units, angles intrinsic z-y'-x''."""
    position, angles = T[:3, 3] / MM, rotation.to_zyx(T[:3, :3]) / DEG
    names = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
    return {name: round(float(value), 6) for name, value in zip(names, [*position, *angles], strict=True)}


def rounded(values: Float, digits: int) -> list[float]:
    """Numbers with so many decimals, without a negative zero."""
    return [round(float(value), digits) + 0.0 for value in values]
