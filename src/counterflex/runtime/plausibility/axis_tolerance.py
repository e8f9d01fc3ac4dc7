"""How far axis angles and pose of the same telegram may disagree: numbers only, for cell files."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import as_positive
from counterflex.core.units import DEG, MM


@dataclass(frozen=True)
class AxisTolerance:
    """How far axis angles and pose of a telegram may disagree.

    Attributes:
        position_m: Between the pose of the telegram and that of the angles, offset of the frames taken off: geometry
            of the controller against that of the description.
        rotation_rad: Likewise, orientation.
        offset_m: Largest offset of the frames.
        offset_rad: Likewise.
    """

    position_m: float = 2.0 * MM
    rotation_rad: float = 0.2 * DEG
    offset_m: float = 20.0 * MM
    offset_rad: float = 3.0 * DEG

    def __post_init__(self) -> None:
        """Check that they are lengths and angles above zero.

        Raises:
            InputError: One is not.
        """
        for name in ("position_m", "rotation_rad", "offset_m", "offset_rad"):
            as_positive(f"axis check: {name}", getattr(self, name))
