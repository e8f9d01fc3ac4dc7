"""Where values of a calibration certificate may go: keys of a cell file and of the manifest of a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to

_N, _NM, _PER_N, _PER_NM = (1, 1, -2, 0, 0, 0), (2, 1, -2, 0, 0, 0), (-1, -1, 2, 0, 0, 0), (-2, -1, 2, 0, 0, 0)
_M, _KG = (1, 0, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0)
BODY: Final = "end_effector.NAME.mass_kg"
MATRIX: Final = "sensor.frame.matrix"


@dataclass(frozen=True)
class Key:
    """A place for a value."""

    name: str  # As it is named at the prompt
    file: Literal["cell", "dataset"]  # ``cell`` or ``dataset``
    exponents: tuple[int, ...] | None  # Of the base units that the value must have; None where the key judges itself
    counts: tuple[int, ...]  # How many numbers it takes; empty takes any
    text: str
    uncertain: bool = False  # The uncertainty is what goes there, so that one must be stated


KEYS: Final[dict[str, Key]] = {
    key.name: key
    for key in (
        Key("sensor.range_n", "cell", _N, (1,), "measuring range of the force, N"),
        Key("sensor.range_nm", "cell", _NM, (1,), "measuring range of the moment, N m"),
        Key("sensor.frame.counts_per_n", "cell", _PER_N, (1,), "sensitivity to force, units of a component per N"),
        Key("sensor.frame.counts_per_nm", "cell", _PER_NM, (1,), "sensitivity to moment, units of a component per N m"),
        Key(MATRIX, "cell", None, (36,), "calibration matrix, rows Fx to Mz: N or N m per unit of a channel"),
        Key(BODY, "cell", _KG, (1,), "mass of a body of the end effector, kg"),
        Key("channels.distance", "dataset", _M, (1,), "length of a ball bar or artefact, m", True),
        Key(
            "settings.force_accuracy_n", "dataset", _N, (), "expanded uncertainty (k = 2) of the force sensor, N", True
        ),
    )
}
"""Keys by name; NAME in :data:`BODY` stands for a body of the cell."""


def key_of(name: str) -> tuple[Key, str]:
    """The key that a name means, and the body that it names.

    Args:
        name: Such as ``sensor.range_n`` or ``end_effector.spindle.mass_kg``.

    Raises:
        InputError: None of :data:`KEYS`.
    """
    first, _, rest = name.partition(".")
    body, _, last = rest.rpartition(".")
    if first == "end_effector" and last == "mass_kg" and body:
        return KEYS[BODY], body
    if name not in KEYS or name == BODY:
        close = close_to(name, KEYS, 1)
        raise InputError(
            "not a key that a certificate fills", where="--set", value=name, limit=", ".join(KEYS),
            hint=f"Did you mean {close[0]}?" if close else None,
        )  # fmt: skip
    return KEYS[name], ""


def pair_of(text: str) -> tuple[str, str]:
    """Key and quantity of ``KEY`` or ``KEY=QUANTITY``; the quantity is empty where it is not named.

    Raises:
        InputError: Not a key, or an empty quantity.
    """
    name, equals, quantity = (part.strip() for part in text.partition("="))
    key_of(name)
    if equals and not quantity:
        raise InputError("which quantity is not said", where="--set", value=text, limit="KEY=QUANTITY or KEY")
    return name, quantity
