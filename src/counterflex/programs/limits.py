"""Limits of controllers: decimals, lines, names, sizes, each with its source.

``measured`` marks what was tried with the program named; ``manual`` what vendors' manuals state; ``cautious`` a
setting of ours that stays far below what is known to work, because no binding figure is published.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Limits:
    """Limits of a program language on its controller."""

    line_characters: int  # Longest line
    name_characters: int  # Longest program or module name
    points_per_file: int  # Largest number of motion instructions in one file; longer programs are split
    position_decimals: int  # Decimals of a position in mm
    angle_decimals: int  # Decimals of an angle in deg (quaternion components in RAPID)
    source: str  # Where the figures come from

    def __post_init__(self) -> None:
        least = {"line_characters": 1, "name_characters": 1, "points_per_file": 1, "position_decimals": 0}
        for name, low in {**least, "angle_decimals": 0}.items():
            if getattr(self, name) < low:
                raise InputError(
                    f"{name} of a controller is out of range", value=getattr(self, name), limit=f">= {low}"
                )


LINUXCNC: Final = Limits(
    line_characters=252,
    name_characters=255,
    points_per_file=10_000_000,
    position_decimals=4,
    angle_decimals=5,
    source="line length, comments included: the RS274/NGC interpreter refuses 253 as too long (measured); number of "
    "lines: none known (cautious)",
)

LINUXCNC_RADIUS_ABSOLUTE_M: Final = 5e-6
"""m. Radii at the start and end of an arc may differ by this much whatever the radius (LinuxCNC, G2/G3)."""
LINUXCNC_RADIUS_RELATIVE: Final = 1e-3
"""Radii may differ by this share of the radius (LinuxCNC, G2/G3), but never by more than the next figure."""
LINUXCNC_RADIUS_LARGEST_M: Final = 0.5e-3
"""m. Largest difference of the radii at the start and end of an arc in any case (LinuxCNC, G2/G3)."""

WORDS_OF_M: Final[dict[int, str]] = {
    19: "RPQ",
    **dict.fromkeys((48, 49, 50, 51, 52, 53, 62, 63, 64, 65), "P"),
    61: "Q",
    66: "PELQ",
    **dict.fromkeys((67, 68), "EQ"),
    **dict.fromkeys((97, 98), "PL"),
}
"""Words that an M-code of G-code takes, by its number."""

_WORDS: Final = """
ABS ACCESS ACOS ALIAS AND ATAN2 BACKWARD BAS BEGIN BOOL BRAKE BREAK CASE CELL CHAR CIRC CONFDATA CONNECT CONST
CONTINUE COS DECL DEF DEFAULT DEFDAT DEFFCT DELAY DISABLE DIV DO ELSE ELSEIF ENABLE END ENDDAT ENDFCT ENDFOR ENDFUNC
ENDIF ENDLOOP ENDMODULE ENDPROC ENDRECORD ENDSPLINE ENDSWITCH ENDTEST ENDTRAP ENDWHILE ENUM ERROR EXIT EXT FALSE FOR
FRAME FROM FUNC GLOBAL GOTO HALT IF IMPORT INOUT INT INTERRUPT IR_STOPM IS LIN LOCAL LOOP MAIN MAXIMUM MINIMUM MOD
MODULE MOVEABSJ MOVEC MOVEJ MOVEL NOSTEPIN NOT NOVIEW NULLFRAME OF OR PERS POS PRIO PROC PTP PUBLIC PULSE RAISE
READONLY REAL RECORD REPEAT RESUME RETRY RETURN SEC SIGNAL SIN SLIN SPEEDDATA SPL SPLINE SPS SPTP SQRT STEP STOP STRUC
SWITCH SYSMODULE TAN TEST THEN TO TOOLDATA TRAP TRIGGER TRUE TRYNEXT UNDO UNTIL USER VAR VARSTATE VIEWONLY WAIT WHEN
WHILE WITH WOBJDATA XHOME XOR XSTART
"""
RESERVED: Final = frozenset(re.findall(r"\w+", _WORDS))
"""Words of KRL and RAPID, and programs that a controller has of its own; no program may be called that."""


def check_name(name: str, limits: Limits, language: str) -> str:
    """Return a program name that the controller accepts as it stands.

    Args:
        name: Letters, digits and underscore, a letter first.
        limits: Limits of the language.
        language: Named in the error.

    Raises:
        InputError: The name is too long or holds other characters.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise InputError(
            f"{language} cannot use this name", value=repr(name), limit="letters, digits, _; a letter first"
        )
    if len(name) > limits.name_characters:
        raise InputError(
            f"the name is too long for {language}", value=len(name), limit=f"<= {limits.name_characters} characters"
        )
    if name.upper() in RESERVED:
        raise InputError(f"{language} cannot use this name", value=repr(name), limit="no word of the language")
    return name
