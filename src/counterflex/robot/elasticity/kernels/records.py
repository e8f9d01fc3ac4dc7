"""Arguments of the kernels of the elastic chain: the compact chain, and what an online step writes and works on.

Work arrays of the kernels are plain: ``frame`` (m + 1, 12) rotation row by row and position of each station after its
drive, last row the TCP; ``delta`` (m, 6) elastic displacements, rows of rigid stations zero; ``trig`` (12,) cosines
then sines of the joints.
"""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from counterflex.core.arrays import Float2
from counterflex.core.jit import bundle
from counterflex.core.records import Records, record

STATION: Final = record(
    rotation=(float, 9),
    position=(float, 3),
    sign=float,
    compliance=(float, 6),
    mass=float,
    com=(float, 3),
    carried=float,
    turn=int,
    drive=int,
    rotates=int,
    slides=int,
    balanced=int,
    segment=int,
)
"""A driven or elastic segment, or the TCP, of which only the fixed pose means something.

``rotation`` by rows and ``position`` (m): fixed pose in the station before, the drive's offset included, and ``turn``
the kind of that rotation: 0 none, 1 about x, 2 about y, 3 about z, 4 general. ``drive``: joint 0..5 or -1, with
``sign``. ``compliance`` (m/N, rad/(N m)); ``rotates`` and ``slides``: 1 where one of its rotations or translations is
not rigid. ``mass`` (kg) and ``com`` (m, in the station's frame) of the bodies that ride on it, ``carried`` (kg) of it
and all beyond. ``balanced``: sign times (joint + 1) where the counterbalance acts on this torsion, else 0.
``segment``: its index in the chain, -1 for the TCP.
"""

SURROUNDINGS: Final = record(
    gravity=(float, 3),
    anchor_column=float,
    anchor_arm=float,
    q_min_force=float,
    piston_area=float,
    gas_constant=float,
    gas_volume_max=float,
)
"""Gravity (m/s2, base axes) and the counterbalance of :class:`counterflex.robot.model.description.Counterbalance`."""

MOST_ANGLES: Final = 8
"""Equals the most of :data:`counterflex.robot.model.elastic_region.ANGLES`."""

REGION: Final = record(
    station=int,
    direction=int,
    axis=int,
    angles_given=int,
    angles=(float, MOST_ANGLES),
    factors=(float, MOST_ANGLES),
)
"""Factors on the compliance of one station in one direction 0..5, by the angle (rad) of one axis."""


class Compact(NamedTuple):
    """A chain for the kernels; made by :func:`counterflex.robot.elasticity.compact.compact`."""

    stations: Annotated[Records, (STATION,)]  # (m + 1,) STATION, the last one the TCP
    surroundings: Annotated[Records, (SURROUNDINGS,)]  # (1,) SURROUNDINGS
    regions: Annotated[Records, (REGION,)]  # (r,) REGION


CHAIN: Final = bundle(Compact)

STEP: Final = record(
    T0=(float, 16),
    Te=(float, 16),
    compliance=(float, 36),
    deflection=(float, 6),
    q=(float, 6),
    Tc=(float, 16),
    residual=(float, 6),
    sigma=float,
)
"""Results of an online step: rigid and deflected pose at q; compliance; deflection; corrected angles, rigid pose there
and the deflection that is left; distance from singularity. Matrices by rows."""

ROW: Final = 36
WORK: Final = record(
    trig=(float, ROW),
    jacobian=(float, ROW),
    factor=(float, ROW),
    inverse=(float, ROW),
    error=(float, ROW),
    half=(float, ROW),
    move=(float, ROW),
    nominal=(float, ROW),
    free=(float, ROW),
)
"""Work space of an online step; run logs hold it as nine rows of 36.

Cosines and sines (12), rigid Jacobian (36), Cholesky factor and its inverse (21 each), error, half of the solution and
joint step (6 each), undeflected pose (12).
"""


class Elastic(NamedTuple):
    """Arrays of an online step: the chain, its results and its work arrays."""

    chain: Compact  # compact chain
    results: Annotated[Records, (STEP,)]  # (1,) STEP, written
    frame: Float2  # (m + 1, 12) work array
    delta: Float2  # (m, 6) likewise
    works: Annotated[Records, (WORK,)]  # (1,) WORK


ELASTIC: Final = bundle(Elastic)
