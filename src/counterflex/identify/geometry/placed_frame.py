"""A frame that measurements place: a first estimate, displaced by six parameters.

``T = T0 D(d)`` with ``D(d) = Trans(d_0..2) Exp(d_3..5)`` and d read from the parameters; an index of -1 is a component
that stays zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, MRAD
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation_derivative import left_jacobian
from counterflex.identify.solver.parameters import Parameter

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
NO_PARAMETERS: Int = np.full(6, -1, dtype=np.int64)


def components(x: Float, index: Int) -> Float:
    """Values (6,) of the parameters at six places of x, zero where the place is -1."""
    return np.where(index >= 0, x[index], 0.0)


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """A frame with parameters.

    Attributes:
        T0: (4, 4) first estimate.
        index: (6,) places of its displacement among the parameters, or -1.
    """

    T0: Float
    index: Int

    def at(self, x: Float) -> Float:
        """The frame (4, 4) at the values x (p,) of all parameters."""
        d = components(x, self.index)
        out: Float = self.T0 @ pose.make(rotation.exp(d[3:]), d[:3])
        return out

    def turned(self, x: Float) -> Float:
        """(3, 3) what a unit change of the rotation parameters turns, in the axes of ``T0``: columns, rad per rad."""
        return left_jacobian(components(x, self.index)[3:])


def frame_parameters(name: str, label: str, sigma: Float | None = None, *, point: bool = False) -> list[Parameter]:
    """Six parameters of a frame's displacement from its first estimate.

    Args:
        name: Of the frame, for example ``T_base_tracker``.
        label: What a user calls it, for example ``tracker in the base``.
        sigma: (6,) m, rad prior standard deviations of the first estimate, or None where nothing is known.
        point: Only its origin matters: three parameters.

    Returns:
        Parameters ``<name>.x`` ... ``<name>.rz``, nominally zero.
    """
    return [
        Parameter(
            name=f"{name}.{c}",
            unit="m" if i < 3 else "rad",
            nominal=0.0,
            prior_sigma=np.inf if sigma is None else float(sigma[i]),
            scale=MM if i < 3 else MRAD,
            label=f"{label}, {c}",
        )
        for i, c in enumerate(COMPONENTS[: 3 if point else 6])
    ]
