"""Table ``[axis_sag]`` of a cell file: how far own weight turns axes 2 and 3 of an arm whose masses are not known."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from counterflex.core.units import MRAD
from counterflex.files.schema import Table
from counterflex.robot.elasticity.axis_sag import AxisSag
from counterflex.robot.elasticity.chain import ElasticChain

Moment = Annotated[float, Field(ge=-1e3, le=1e3)]
Pair = tuple[Moment, Moment]
"""Along x and y of the link's segment, mrad."""


class AxisSagTable(Table):
    """Compliance of an axis times the weight's first moment of what it carries."""

    axis2_by_link2_mrad: Pair = (0.0, 0.0)
    axis2_by_link3_mrad: Pair = (0.0, 0.0)
    axis3_by_link3_mrad: Pair = (0.0, 0.0)
    source: str = ""

    def sag(self, chain: ElasticChain) -> AxisSag:
        """The same in SI, on a chain. Raises :class:`ModelError` where the numbers are far too large."""
        rows = (self.axis2_by_link2_mrad, self.axis2_by_link3_mrad, self.axis3_by_link3_mrad)
        return AxisSag(chain, np.array(rows, dtype=np.float64).ravel() * MRAD)
