"""Compliances of the elastic elements of a chain as parameters of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int, frozen
from counterflex.core.errors import InputError
from counterflex.core.similar import close_to
from counterflex.core.units import MM, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.identify.data.changes import ElementCompliance
from counterflex.identify.geometry.arm_parameters import ArmModel
from counterflex.identify.geometry.known_frames import KnownFrames
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals, frame_parameters
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.elasticity.chain import ElasticChain

POSITION_M: Final = 50.0 * UM
ROTATION_RAD: Final = 100.0 * URAD
"""What a pose may be off by for other reasons than geometry: tracker, play, friction."""


def foreseen(model: ArmModel, q: Float, known: KnownFrames | None) -> tuple[Parameters, TrackerResiduals]:
    """Parameters, and the residuals that readings of a six-axis target at poses not yet measured would have.

    ``q``: (n, 6) rad. ``known``: First estimates of tracker and target; None: in the base and at the tool tip.

    Returns:
        The parameters of the arm, ``T_base_tracker.*`` and ``T_tcp_target.*`` (nothing is known of these two); the
        residuals, whose Jacobian counts, weighted by :data:`POSITION_M` and :data:`ROTATION_RAD`.
    """
    first = len(model.parameters)
    parameters = model.parameters + Parameters.of(
        [*frame_parameters("T_base_tracker", "tracker in the base"), *frame_parameters("T_tcp_target", "target")]
    )
    T0 = np.eye(4) if known is None else known.T_base_tracker
    X0 = np.eye(4) if known is None else known.T_tcp_target
    block = TrackerResiduals(
        "candidates",
        np.arange(len(q), dtype=np.int64),
        np.tile([POSITION_M] * 3 + [ROTATION_RAD] * 3, (len(q), 1)),
        model.at(q),
        PlacedFrame(T0, np.arange(first, first + 6, dtype=np.int64)),
        PlacedFrame(X0, np.arange(first + 6, first + 12, dtype=np.int64)),
        np.zeros((len(q), 3)),
        np.broadcast_to(np.eye(3), (len(q), 3, 3)),
    )
    return parameters, block


DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")
TRANSLATION_M_N: Final = 5.0 * UM_PER_KN
"""Compliance that a freed rigid direction is expected to have at most, one standard deviation, m/N."""
ROTATION_RAD_NM: Final = 100.0 * URAD_PER_KNM
"""The same for rotations, rad/(N m): a stiffness of 1e7 N m/rad."""
_RIGID: Final = 1e-12  # m/N, rad/(N m): what is stiffer is written as rigid
_RANGE: Final = 1e3  # a compliance stays within this factor of what the cell file says
SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
    "prior": 0.3,
    "wide": "",
    "wide_prior": 1.0,
    "known": "",
    "known_prior": 0.05,
    "free": "",
    "held": "",
    "bearing_mm": 10.0,
}
"""Options of recipes that find compliances: relative prior standard deviation of an element; names of elements, or of
single directions as ``axis2.rx``, whose values are assumed, and their prior; the same for what a data sheet or a bench
says; names of rigid directions to free; names of elements or directions to hold. ``all`` stands for everything,
``torsion``, ``tilting`` and ``translation`` for the directions z; x and y; tx, ty, tz of all driven axes.
``bearing_mm``: how well the centres of the elements are known, per axis."""
_OF_AXES: Final = {"torsion": (5,), "tilting": (3, 4), "translation": (0, 1, 2)}


@dataclass(frozen=True, eq=False)
class Springs:
    """Directions of elements that are parameters, in the order of the parameters."""

    segment: Int  # (k,) index of the element in the chain
    direction: Int  # (k,) 0..5 of `tx ty tz rx ry rz`
    parameters: Parameters  # k parameters named `axis1.rz`, m/N or rad/(N m)

    def __len__(self) -> int:
        return len(self.segment)

    def compliance(self, chain: ElasticChain, values: Float) -> Float:
        """Compliances (n, 6) of the whole chain with the values (k,) of the parameters."""
        out = np.array(chain.compliance)
        out[self.segment, self.direction] = values
        return out

    def of_chain(self, chain: ElasticChain) -> Float:
        """(k,) what a chain has in these directions."""
        out: Float = chain.compliance[self.segment, self.direction]
        return out

    def changes(self, chain: ElasticChain, values: Float) -> tuple[ElementCompliance, ...]:
        """Changes to the cell file: every element with a free parameter, whole."""
        # A file that says 1e-15 would make the next identification free a direction that this one found rigid.
        whole = self.compliance(chain, np.where(values < _RIGID, 0.0, values))
        touched = sorted({int(s) for s, p in zip(self.segment, self.parameters, strict=True) if p.free})
        return tuple(ElementCompliance(chain.names[i], whole[i]) for i in touched)


def bearing_of(settings: Mapping[str, Any]) -> float:
    """The setting ``bearing_mm`` in m. Raises InputError: negative or beyond 200 mm."""
    value = settings.get("bearing_mm", SETTINGS["bearing_mm"])
    if not (isinstance(value, int | float) and 0.0 <= float(value) <= 200.0):
        raise InputError("setting bearing_mm", value=value, limit="0 .. 200 mm")
    return float(value) * MM


def with_compliance(chain: ElasticChain, compliance: Float) -> ElasticChain:
    """The same chain with other compliances (n, 6), m/N and rad/(N m)."""
    return replace(chain, compliance=frozen(compliance))


def springs(chain: ElasticChain, settings: Mapping[str, Any]) -> Springs:
    """Every elastic direction of a chain as a parameter.

    A direction with a compliance above zero is logarithmic around it with a relative prior; a rigid one that is freed
    is linear from zero up, with a prior of :data:`TRANSLATION_M_N` or :data:`ROTATION_RAD_NM`.

    ``settings``: See :data:`SETTINGS`; lists of names are separated by commas or blanks.

    Returns:
        The parameters, in the order of the chain.

    Raises:
        InputError: A name that the chain does not have, a prior that is not positive, or nothing elastic at all.
    """
    options = {**SETTINGS, **settings}
    for key in ("prior", "wide_prior", "known_prior"):
        if not (isinstance(options[key], int | float) and 0.0 < float(options[key]) <= 10.0):
            raise InputError(f"setting {key}", value=options[key], limit="a relative standard deviation above 0, <= 10")
    wide, known, free, fixed = (named_directions(chain, str(options[key])) for key in ("wide", "known", "free", "held"))
    items, segment, direction = [], [], []
    for i, d in np.ndindex(chain.n, 6):
        value, place = float(chain.compliance[i, d]), (i, d)
        if value > 0.0:
            kind = "known_prior" if place in known else "wide_prior" if place in wide else "prior"
            items.append(_elastic(chain.names[i], d, value, float(options[kind]), free=place not in fixed))
        elif place in free and (value == 0.0 and place not in fixed):
            items.append(_freed(chain.names[i], d))
        else:
            continue
        segment.append(i)
        direction.append(d)
    if not items:
        raise InputError(
            "nothing in this cell is elastic, so there is no compliance to identify",
            value=chain.name,
            hint="Give each axis a rough compliance in [[robot.elastic]], or free rigid directions: "
            '--set free="axis1.rz axis2.rz axis3.rz"',
        )
    return Springs(np.array(segment, dtype=np.int64), np.array(direction, dtype=np.int64), Parameters.of(items))


def _words(name: str, d: int) -> tuple[str, str, str]:
    """Name, unit and label of the parameter of a direction."""
    unit, kind = ("m/N", "translation") if d < 3 else ("rad/(N m)", "rotation")
    return f"{name}.{DIRECTIONS[d]}", unit, f"{name} {kind} {DIRECTIONS[d][1]}"


def _elastic(segment: str, d: int, value: float, sigma: float, *, free: bool) -> Parameter:
    name, unit, label = _words(segment, d)
    lower, upper = value / _RANGE, value * _RANGE
    return Parameter(name, unit, value, sigma, lower=lower, upper=upper, free=free, log=True, label=label)


def _freed(segment: str, d: int) -> Parameter:
    name, unit, label = _words(segment, d)
    sigma = TRANSLATION_M_N if d < 3 else ROTATION_RAD_NM
    return Parameter(name, unit, 0.0, sigma, lower=0.0, upper=_RANGE * sigma, label=label)


def named_directions(chain: ElasticChain, names: str) -> set[tuple[int, int]]:
    """Elements and directions (segment, 0..5) that a text names: ``all``, ``tilting``, ``axis2``, ``axis2.rx``.

    Raises:
        InputError: A name that the chain does not have.
    """
    directions: set[tuple[int, int]] = set()
    for word in names.replace(",", " ").split():
        if word == "all":
            return {(i, d) for i in range(chain.n) for d in range(6)}
        if word in _OF_AXES:
            directions |= {(int(i), d) for i in np.flatnonzero(chain.joint >= 0) for d in _OF_AXES[word]}
            continue
        element, _, letter = word.partition(".")
        if element not in chain.names or (letter and letter not in DIRECTIONS):
            raise _no_such(chain, word)
        i = chain.names.index(element)
        directions |= {(i, d) for d in range(6) if not letter or DIRECTIONS[d] == letter}
    return directions


def _no_such(chain: ElasticChain, word: str) -> InputError:
    letter = word.partition(".")[2]
    known = [f"{name}.{d}" for name in chain.names for d in DIRECTIONS] if letter else list(chain.names)
    close = close_to(word, known, 1)
    return InputError(
        "the cell has no such elastic element or direction",
        value=word,
        limit=", ".join((*chain.names, "all", *_OF_AXES)) + "; directions " + " ".join(DIRECTIONS),
        hint=f"Did you mean '{close[0]}'?" if close else None,
    )
