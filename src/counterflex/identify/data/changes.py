"""Changes to a cell by an identification, in SI; :mod:`counterflex.files.cell.update` writes them into a cell file."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.robot.model.description import ComplianceCurve, ElasticRegion, Play, Servo


@dataclass(frozen=True, eq=False)
class ElementCompliance:
    """Compliance of one elastic element, of the robot or of the end effector."""

    segment: str
    compliance: Float  # (6,) `tx ty tz rx ry rz` m/N, rad/(N m); all of it


@dataclass(frozen=True)
class ElementRegion:
    """A factor on one compliance.

    Over the angle of one axis, times those that the cell file has already; or over the load, instead of the one it has.
    """

    region: ElasticRegion | ComplianceCurve


@dataclass(frozen=True, eq=False)
class Calibration:
    """Displacement of what follows a segment against the nominal geometry, constant in the segment's frame.

    ``T_seg_next = D(displacement) T_seg_next,nominal`` with ``D = Trans(x, y, z) Exp(rotation vector)``; for a driven
    segment the rotation about z is the offset of its joint (times its sign).
    """

    segment: str  # name of a segment, `base` (before the first) or `tcp` (in the last body: of the tool itself)
    displacement: Float  # (6,) m, rad: the whole, not what is added to an earlier calibration


@dataclass(frozen=True)
class AxisPlay:
    """Play and dry friction of axis 0..5."""

    axis: int
    play: Play


@dataclass(frozen=True)
class AxisServo:
    """Loop gains of axis 0..5."""

    axis: int
    servo: Servo


@dataclass(frozen=True, eq=False)
class BodyMass:
    """Mass of a segment and its centre of gravity (3,) m in the segment's frame."""

    segment: str
    mass_kg: float
    p_seg_com: Float


@dataclass(frozen=True, eq=False)
class CuttingLaw:
    """Force law of the material."""

    law: ForceLaw


@dataclass(frozen=True, eq=False)
class TableValues:
    """Values of a table of the cell file that has no counterpart here, in the file's own keys and units."""

    table: str  # name of the table, for example `tracker`
    # by key, in shop units as docs/cell-file.md has them
    values: dict[str, float | str | bool | list[float] | list[list[float]]]


Change = ElementCompliance | ElementRegion | Calibration | AxisPlay | AxisServo | BodyMass | CuttingLaw | TableValues
