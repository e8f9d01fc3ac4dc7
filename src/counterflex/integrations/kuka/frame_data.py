"""``$config.dat`` of a KUKA controller: TOOL_DATA, BASE_DATA, LOAD_DATA and their names."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.app.controller_import.frames import ControllerData, Load
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.programs.robot_text.process_words import NUMBER

_LINE: Final = re.compile(
    r"^\s*(TOOL|BASE|LOAD)_(DATA|NAME)\s*\[\s*(\d+)\s*,?\s*\]\s*=\s*(.*?)\s*(?:;.*)?$", re.IGNORECASE
)
_PART: Final = re.compile(rf"\b([XYZABC])\s+({NUMBER})", re.IGNORECASE)
_FRAME: Final = re.compile(
    rf"\{{\s*(?:\w+\s*:\s*)?[A-Z]\d?\s+{NUMBER}(?:\s*,\s*[A-Z]\d?\s+{NUMBER})*\s*\}}", re.IGNORECASE
)
"""Components with nothing between them: a decimal comma would leave half a number."""
_MASS: Final = re.compile(rf"\{{\s*M\s+({NUMBER})\s*,\s*CM\s*\{{([^{{}}]*)\}}", re.IGNORECASE)
_HEAD: Final = re.compile(r"^\s*DEFDAT\s+\$CONFIG\b", re.IGNORECASE | re.MULTILINE)
_AS_SAVED: Final = "Give the file as the controller saved it"
_KINDS: Final = {"TOOL": "tool", "BASE": "base"}


def is_kuka(text: str) -> bool:
    """Return whether a text is a ``$config.dat``."""
    return _HEAD.search(text) is not None


def read_kuka(text: str, where: str) -> ControllerData:
    """Frames of a ``$config.dat``; those that are all zeros were never set, and are left out.

    Args:
        where: Its name, for errors.

    Raises:
        FileFormatError: A frame that is set is damaged, or there twice.
    """
    out = ControllerData("KUKA")
    seen: set[tuple[str, str, str]] = set()
    for line, content in enumerate(text.splitlines(), start=1):
        match = _LINE.match(content)
        if match is None:
            continue
        word, kind, number, value = match[1].upper(), match[2].upper(), match[3], match[4]
        place = f"{where}:{line}"
        if (word, kind, number) in seen:
            raise FileFormatError(f"{word}_{kind}[{number}] is there twice", where=place,
                                  hint="Give the file as the controller saved it")  # fmt: skip
        seen.add((word, kind, number))
        if kind == "NAME":
            name = value.strip().strip('"').strip()
            if name and word in _KINDS:
                out.titles[f"{_KINDS[word]} {number}"] = name
        elif word == "LOAD":
            _load(out, number, value, place)
        else:
            T = frame_of_text(value, place)
            if np.any(np.eye(4) != T):
                (out.tools if word == "TOOL" else out.bases)[number] = T
    return out


def frame_of_text(text: str, where: str) -> Float:
    """(4, 4) m of ``{X ..,Y ..,Z ..,A ..,B ..,C ..}``.

    Raises:
        FileFormatError: It is something else.
    """
    parts = [(match[1].upper(), float(match[2])) for match in _PART.finditer(text)]
    values = dict(parts)
    if sorted(letter for letter, _ in parts) != sorted("XYZABC") or _FRAME.fullmatch(text) is None:
        raise FileFormatError("a frame is damaged", where=where, value=text[:60], hint=_AS_SAVED,
                              limit="{X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}")  # fmt: skip
    R = rotation.from_zyx(np.array([values[c] for c in "ABC"]) * DEG)
    return pose.make(R, np.array([values[c] for c in "XYZ"]) * MM)


def _load(out: ControllerData, number: str, text: str, where: str) -> None:
    match = _MASS.match(text)
    if match is None or _FRAME.fullmatch(f"{{{match[2]}}}") is None:
        raise FileFormatError("load data are damaged", where=where, value=text[:60], hint=_AS_SAVED,
                              limit="{M 86.0,CM {X 0.0,...},J {...}}")  # fmt: skip
    mass = float(match[1])
    if mass <= 0.0:
        return  # -1: the load on the plate is that of the machine data
    com = {part[1].upper(): float(part[2]) for part in _PART.finditer(match[2])}
    x, y, z = (com.get(letter, 0.0) * MM for letter in "XYZ")
    out.loads[number] = Load(mass, (x, y, z))
