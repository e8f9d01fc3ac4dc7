"""Families of truths: how far a simulated cell is from what is published of it, and which seeds are for what.

``mild`` is near what is published: every value 5 to 20 % off, stiffness independently, so that much of it averages out.
``wide`` is a cell of which only catalogue and handbook are known: large deviations of each value and, in addition,
one common factor of all compliances and one of all force constants, which nothing averages out. ``other`` is a cell
with other kinds of physics than any planner here has a model of, see :mod:`counterflex.twin.truth.draw_other`; its
values are off by amounts between the two, its drives by more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError

FIRST_SEED: Final = 1
"""Where a job begins to count unless it is told otherwise."""
TUNING_SEEDS: Final = range(1000)
"""Seeds on which methods and constants may be tried out and tuned."""
REPORTING_SEEDS: Final = range(1001, 1021)
"""Seeds for published figures only: nothing was tuned on them."""


@dataclass(frozen=True)
class Family:
    """Standard deviations of a family; those of factors are of the factor's logarithm, so 0.1 is 10 %."""

    name: str  # as ``--family`` and the truth file call it
    compliance_sigma: float  # of each elastic element, all its entries together
    compliance_common_sigma: float  # of all elements together
    region_sigma: float  # of what a region of the joint space changes of a compliance
    force_common_sigma: float  # of all force constants together
    force_each_sigma: float  # of cutting, radial and axial constants separately
    friction_sigma: float  # of the dry friction of each axis
    play_sigma: float  # of the dead band of each axis
    slip_sigma: float  # of the angles over which friction reverses
    servo_sigma: float  # of the gain of each speed loop
    loop_sigma: float  # of position gain and integral time of each axis
    mass_sigma: float  # of each body, its inertia with it
    other: bool = False  # whether there are other kinds of physics


MILD: Final = Family(
    name="mild",
    compliance_sigma=0.10,
    compliance_common_sigma=0.0,
    region_sigma=0.10,
    force_common_sigma=0.10,
    force_each_sigma=0.03,
    friction_sigma=0.20,
    play_sigma=0.20,
    slip_sigma=0.20,
    servo_sigma=0.10,
    loop_sigma=0.05,
    mass_sigma=0.10,
)
WIDE: Final = Family(
    name="wide",
    compliance_sigma=0.30,
    compliance_common_sigma=0.20,
    region_sigma=0.30,
    force_common_sigma=0.20,
    force_each_sigma=0.30,
    friction_sigma=0.30,
    play_sigma=0.30,
    slip_sigma=0.30,
    servo_sigma=0.30,
    loop_sigma=0.30,
    mass_sigma=0.15,
)
OTHER: Final = Family(
    name="other",
    compliance_sigma=0.12,
    compliance_common_sigma=0.08,
    region_sigma=0.30,
    force_common_sigma=0.08,
    force_each_sigma=0.08,
    friction_sigma=0.20,
    play_sigma=0.30,
    slip_sigma=0.30,
    servo_sigma=0.35,
    loop_sigma=0.35,
    mass_sigma=0.15,
    other=True,
)
FAMILIES: Final = {family.name: family for family in (MILD, WIDE, OTHER)}


def family_of(name: str) -> Family:
    """The family of a name. Raises InputError: there is none of that name."""
    if name not in FAMILIES:
        raise InputError("unknown family of truths", value=name, limit=", ".join(FAMILIES))
    return FAMILIES[name]
