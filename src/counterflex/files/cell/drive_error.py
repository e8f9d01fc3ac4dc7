"""Table ``[drive_error]`` of a cell file: periodic errors of the drives."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from counterflex.core.units import DEG, URAD
from counterflex.files.schema import Table
from counterflex.robot.elasticity.drive_error import DriveError, DriveErrors

Order = Annotated[int, Field(ge=1, le=1000)]
Amplitude = Annotated[float, Field(ge=-1e5, le=1e5)]
Harmonics = Annotated[tuple[tuple[Order, Amplitude, Amplitude], ...], Field(max_length=200)]
"""Rows ``[order, sine amplitude in urad, cosine amplitude in urad]``."""


Angle = Annotated[float, Field(ge=-720.0, le=720.0)]
Ranges = Annotated[tuple[tuple[Angle, Angle], ...], Field(max_length=6)]
"""Lowest and highest angle of each of the six axes."""


class DriveErrorTable(Table):
    """Harmonics of the six drives; an axis that is left out has none."""

    axis1: Harmonics = ()
    axis2: Harmonics = ()
    axis3: Harmonics = ()
    axis4: Harmonics = ()
    axis5: Harmonics = ()
    axis6: Harmonics = ()
    measured_deg: Ranges = ()
    source: str = ""

    def errors(self) -> DriveErrors:
        """The errors in SI. Raises :class:`ModelError` where they are far too large."""
        rows = (self.axis1, self.axis2, self.axis3, self.axis4, self.axis5, self.axis6)
        return DriveErrors(
            tuple(
                DriveError(axis, order, sine * URAD, cosine * URAD)
                for axis, harmonics in enumerate(rows)
                for order, sine, cosine in harmonics
            ),
            tuple((low * DEG, high * DEG) for low, high in self.measured_deg),
        )
