"""PLANE: the tilted working plane, by angles, vectors or points.

Source: HEIDENHAIN TNC 640 (34059x-05), Conversational Programming, "The PLANE function: Tilting the working plane":
parameters, positioning MOVE, TURN and STAY. The plane turns about the active datum.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.frames import FrameFault, by_points, by_vectors, euler, spatial
from counterflex.integrations.heidenhain.language.source import KlartextStatement
from counterflex.integrations.heidenhain.language.state import KlartextState
from counterflex.integrations.heidenhain.language.values import VALUE, KlartextValues, required

_HEAD: Final = re.compile(r"\s*PLANE\s+([A-Z]+)", re.IGNORECASE)
_WORD: Final = re.compile(
    rf"\s*(?:(SP[ABC]|EULPR|EULNU|EULROT|[BN][XYZ]|P[123][XYZ]|ABST|DIST|MB|F)\s*({VALUE})"
    r"|(MB\s*MAX|F\s*MAX|F\s*AUTO|STAY|TURN|MOVE|SEQ\s*[+-]|SYM\s*[+-]|TABLE\s+ROT|COORD\s+ROT)(?![A-Z]))",
    re.IGNORECASE,
)
_FORMS: Final = {
    "SPATIAL": ("SPA", "SPB", "SPC"),
    "EULER": ("EULPR", "EULNU", "EULROT"),
    "VECTOR": ("BX", "BY", "BZ", "NX", "NY", "NZ"),
    "POINTS": tuple(f"P{k}{axis}" for k in "123" for axis in "XYZ"),
    "RELATIV": ("SPA", "SPB", "SPC"),
    "RESET": (),
}
_REFUSED: Final = {
    "AXIAL": "positions of rotary axes belong to a machine that is not known",
    "PROJECTED": "the direction of X in a projected plane is not read",
}
_POSITIONING: Final = ("STAY", "TURN", "MOVE")


def tilt(part: KlartextStatement, state: KlartextState, values: KlartextValues, name: str) -> bool:
    """Execute PLANE; whether the tool stands at right angles to the plane behind it.

    Raises:
        ProgramError: It cannot be executed exactly.
    """
    head = _HEAD.match(part.code)
    form = "" if head is None else head[1].upper()
    form = "RELATIV" if form == "RELATIVE" else form
    if head is None or form not in _FORMS:
        what = _REFUSED.get(form, "an unknown way to define a working plane")
        raise part.fault(name, f"{what}: PLANE {form}", None, None, "PLANE SPATIAL SPA+0 SPB+30 SPC+0 TURN FMAX")
    words = _words(part, head.end(), values, name)
    numbers = {key: value for key, (value, _) in words.items() if key in _FORMS[form]}
    _check(part, form, words, numbers, name)
    try:
        if form == "RESET":
            state.frames.set_plane(np.eye(3))
        else:
            state.frames.set_plane(_rotation(form, numbers), relative=form == "RELATIV")
    except FrameFault as fault:
        raise part.fault(name, fault.what, None, None, fault.hint) from fault
    if "MOVE" in words and any(words.get(key, (0.0, 0))[0] != 0.0 for key in ("ABST", "DIST")):
        state.named.clear()
    return "STAY" not in words or (form == "RESET" and not state.vectors)


def _words(part: KlartextStatement, at: int, values: KlartextValues, name: str) -> dict[str, tuple[float, int]]:
    out: dict[str, tuple[float, int]] = {}
    while part.code[at:].strip():
        column = at + len(part.code[at:]) - len(part.code[at:].lstrip())
        match = _WORD.match(part.code, at)
        if match is None:
            raise part.fault(name, "an unknown word of PLANE", column, part.code[column:].split()[0][:20])
        key = "".join((match[1] or match[3]).upper().split())
        if key in out:
            raise part.fault(name, "the word appears twice in PLANE", column, match[0].strip())
        value = 1.0 if match[1] is None else required(values.number(match[2]), key, part.place(name, column), part.code)
        out[key], at = (value, column), match.end()
    return out


def _check(
    part: KlartextStatement, form: str, words: dict[str, tuple[float, int]], numbers: dict[str, float], name: str
) -> None:
    geometric = {key for keys in _FORMS.values() for key in keys}
    for key, (_, column) in words.items():
        if key in geometric and key not in _FORMS[form]:
            raise part.fault(name, f"PLANE {form} does not take this word", column, key)
    if form == "RELATIV":
        if len(numbers) != 1:
            raise _needs(part, name, form, "one of SPA, SPB and SPC")
    elif len(numbers) != len(_FORMS[form]):
        raise _needs(part, name, form, " ".join(_FORMS[form]))
    if sum(key in words for key in _POSITIONING) != 1:
        raise _needs(part, name, form, "one of STAY, TURN and MOVE")


def _needs(part: KlartextStatement, name: str, form: str, what: str) -> ProgramError:
    return part.fault(name, f"PLANE {form} needs {what}", None, None, "PLANE SPATIAL SPA+0 SPB+30 SPC+0 TURN FMAX")


def _rotation(form: str, numbers: dict[str, float]) -> Float:
    values = [numbers.get(key, 0.0) for key in _FORMS[form]]
    if form in ("SPATIAL", "RELATIV"):
        return spatial(*values)
    if form == "EULER":
        return euler(*values)
    vectors = np.array(values).reshape(-1, 3)
    return by_vectors(vectors[0], vectors[1]) if form == "VECTOR" else by_points(vectors)
