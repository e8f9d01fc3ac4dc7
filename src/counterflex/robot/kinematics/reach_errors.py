"""Errors for a pose or a path that cannot be reached."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.kinematics import inverse_kernel
from counterflex.robot.kinematics.inverse_seeds import flange_of
from counterflex.robot.model import opw
from counterflex.robot.model.controller_axes import shown_limits

_MOVE = "Move the part closer to the robot, or away from its foot"


def beyond(chain: ElasticChain, T_base_tcp: Float) -> float | None:
    """Distance of the wrist centre beyond the arm's reach on its better side (rigid OPW geometry).

    Args:
        T_base_tcp: (4, 4) m.

    Returns:
        m, positive; None where it is within reach or the chain has no OPW geometry.
    """
    if chain.opw is None:
        return None
    T_base_flange = flange_of(chain, T_base_tcp)
    reserve = max(float(opw.extension(chain.opw, T_base_flange, back=back)) for back in (False, True))
    return -reserve if reserve < 0.0 else None


def unreached(chain: ElasticChain, T_base_tcp: Float, worst: tuple[str, int, Float] | None) -> ReachError:
    """Error of a pose without solution.

    Args:
        T_base_tcp: (4, 4) m.
        worst: The solution that breaks its joint limits least: branch, axis 0..5, (6,) angles in rad; or None.
    """
    if worst is not None:
        branch, axis, q = worst
        name, value, limit = _limit_words(chain, q, axis)
        return ReachError(
            f"every branch breaks a joint limit; in the best ({branch}) {name} is out",
            value=value,
            limit=limit,
            hint="Move the part or turn the tool about its axis",
            axis=axis,
        )
    gap = beyond(chain, T_base_tcp)
    if gap is not None:
        return ReachError(
            "the pose is out of reach", value=f"wrist centre {gap / MM:.1f} mm beyond the arm", hint=_MOVE
        )
    return ReachError("the pose is not reached by any branch", hint="Move the part or turn the tool about its axis")


def at_point(fault: ReachError, point: int) -> ReachError:
    """The same error, said of a point of a path."""
    return ReachError(
        fault.what,
        where=f"path point {point}",
        value=fault.value,
        limit=fault.limit,
        hint=fault.hint,
        **(fault.data | {"point": point}),
    )


def near_singularity(wrist: float, sigma: float, floor: float) -> ReachError:
    """Error of a pose whose scaled sigma_min is below the floor; ``wrist`` is ``|sin|`` between axes 4 and 6."""
    which = "the wrist singularity (axis 5 near zero)" if wrist < 0.05 else "a singularity of the arm"
    return ReachError(
        f"the pose is too close to {which}",
        value=f"sigma_min {sigma:.2g}",
        limit=f">= {floor:g}",
        hint="Tilt or shift the part, or turn the tool about its axis",
    )


def _limit_words(chain: ElasticChain, q: Float, axis: int) -> tuple[str, str, str]:
    """Name, value and limits of an axis as the controller shows it; of axis 3 also its angle to the upper arm."""
    name, value = f"axis {axis + 1}", float(chain.axes.shown(q)[axis])
    low, high = shown_limits(chain.axes, chain.joint_limits_rad)[axis]
    if chain.axes.coupled and low <= value <= high:
        name, value, (low, high) = f"{name} against the upper arm", float(q[axis]), chain.joint_limits_rad[axis]
    return name, f"{value / DEG:.3f} deg", f"{low / DEG:.3f}..{high / DEG:.3f} deg"


def outside(chain: ElasticChain, q: Float, axis: int, point: int) -> ReachError:
    """Error of a path point at which an axis leaves its range.

    Args:
        q: (6,) rad there.
        axis: 0..5.
    """
    name, value, limit = _limit_words(chain, q, axis)
    return ReachError(
        f"{name} leaves its range",
        where=f"path point {point}",
        value=value,
        limit=limit,
        hint="Choose another branch, or move the part",
        point=point,
        axis=axis,
    )


def path_fault(chain: ElasticChain, T_base_tcp: Float, point: int, code: int, fault: Float, floor: float) -> ReachError:
    """Error of the first path point that :func:`counterflex.robot.kinematics.inverse_kernel.follow` could not do.

    Args:
        T_base_tcp: (4, 4) pose of that point, m.
        fault: (2,) as the kernel leaves it.
        floor: Smallest sigma_min accepted.
    """
    where = f"path point {point}"
    # Out of reach first: the search ends beside the stretched arm, whose singularity is not the reason.
    gap = beyond(chain, T_base_tcp)
    if gap is not None:
        return ReachError(
            "the pose is out of reach",
            where=where,
            value=f"wrist centre {gap / MM:.1f} mm beyond the arm",
            hint=_MOVE,
            point=point,
        )
    if code == inverse_kernel.SINGULAR:
        return ReachError(
            "the path runs too close to a singularity",
            where=where,
            value=f"sigma_min {fault[0]:.2g}",
            limit=f">= {floor:g}",
            hint="Axis 5 near zero or the arm stretched: tilt or move the part, or turn the tool about its axis",
            point=point,
        )
    return ReachError(
        "the pose is not reached on this branch",
        where=where,
        value=f"residual {fault[0]:.2g}, sigma_min {fault[1]:.2g}",
        hint="Choose another branch, or move the part",
        point=point,
    )
