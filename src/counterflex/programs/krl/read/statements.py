"""Statements of KRL by what they are to a milling program: motions, frames, speeds, flow, and others."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from counterflex.programs.krl.read.literals import code_of
from counterflex.programs.robot_text.process_words import NUMBER

_I: Final = re.IGNORECASE
NAME: Final = r"[A-Za-z$]\w*(?:\s*\[\s*\d+\s*\])?"
HEADER: Final = re.compile(r"\s*&")
ROUTINE: Final = re.compile(r"\s*(?:GLOBAL\s+)?DEF\s+(\w+)\s*(?:\(.*\))?\s*", _I)
FUNCTION: Final = re.compile(r"\s*(?:GLOBAL\s+)?DEFFCT\s", _I)
END: Final = re.compile(r"\s*END\s*", _I)
MOTION: Final = re.compile(r"\s*(S?PTP|S?LIN|S?CIRC)(_REL)?(?=[\s{$]|$)", _I)
SPLINE: Final = re.compile(r"\s*(PTP_SPLINE|SPL|TIME_BLOCK|CONST_VEL)\b", _I)
SPLINE_BEGINS: Final = re.compile(r"\s*SPLINE\b(.*)", _I)
SPLINE_ENDS: Final = re.compile(r"\s*ENDSPLINE\b\s*((?:C_(?:DIS|PTP|VEL|ORI|SPL)\s*)*)", _I)
IN_SPLINE: Final = re.compile(
    r"\s*(S?PTP|S?LIN|S?CIRC|SPL|SPLINE|PTP_SPLINE|ENDSPLINE|TIME_BLOCK|CONST_VEL|TRIGGER)\b", _I
)
WITH_VELOCITY: Final = re.compile(rf"\bWITH\b(?:.*,)?\s*\$VEL\.CP\s*=\s*({NUMBER})\s*(?:,|$)", _I)
WITH_VELOCITIES: Final = re.compile(rf"\$VEL\s*=\s*\{{[^{{}}]*?\bCP\s+({NUMBER})\s*[,}}]", _I)
WITH_ANY_VELOCITY: Final = re.compile(r"\$VEL\s*(?:=|\.\s*CP\b)", _I)
WITH_OTHERS: Final = re.compile(r"\s*(?:WITH\s+\$(?:VEL|ACC|ORI_TYPE|GEAR_JERK|JERK|VEL_AXIS|ACC_AXIS)\b.*)?", _I)
APPROXIMATION: Final = re.compile(r"\s*((?:C_(?:DIS|PTP|VEL|ORI|SPL)\s*)*)", _I)
CIRCLE_ANGLE: Final = re.compile(rf"\s*,\s*CA\s+({NUMBER})\s*", _I)
ANY_CIRCLE_ANGLE: Final = re.compile(r"\s*,\s*CA\b", _I)
VELOCITY: Final = re.compile(r"\s*\$VEL\.CP\s*=\s*(.+?)\s*", _I)
VELOCITIES: Final = re.compile(r"\s*\$VEL\s*=\s*(\{.*)", _I)
FRAME: Final = re.compile(r"\s*\$(TOOL|BASE)\s*=\s*(.+?)\s*", _I)
BY_NUMBER: Final = re.compile(r"(TOOL|BASE)_DATA\s*\[\s*(\d+)\s*\]", _I)
NO_FRAME: Final = re.compile(r"\$?(NULLFRAME|WORLD)", _I)
MODE: Final = re.compile(r"\s*\$IPO_MODE\s*=\s*#(\w+)\s*", _I)
ACTUAL: Final = re.compile(rf"\s*([FLP]DAT_ACT)\s*=\s*({NAME}|\{{.*)\s*", _I)
BASIC: Final = re.compile(r"\s*BAS\s*\(\s*#(\w+)\s*(?:,\s*(.*?)\s*)?\)\s*", _I)
BASIC_PASSED: Final = frozenset(
    ("INITMOV", "VEL_PTP", "ACC_PTP", "ACC_CP", "VEL_ORI", "ACC_ORI", "VEL_ORI1", "VEL_ORI2", "PTP_DAT", "OUT_WERKZEUG")
)
WAIT_TIME: Final = re.compile(r"\s*WAIT\s+SEC\s+(.+?)\s*", _I)
TRIGGER: Final = re.compile(r"\s*TRIGGER\s+WHEN\s+(.*?)\s+DO\s+(.*?)(?:\s+PRIO\s*=.*)?\s*", _I)
AT_START: Final = re.compile(r"DISTANCE\s*=\s*0(\.0*)?\s+DELAY.*|PATH\s*=.*\bONSTART\b.*", _I)
OPENS: Final = re.compile(r"\s*(IF|FOR|WHILE|LOOP|REPEAT|SWITCH)\b", _I)
CLOSES: Final = re.compile(r"\s*(ENDIF|ENDFOR|ENDWHILE|ENDLOOP|UNTIL|ENDSWITCH)\b", _I)
CLOSED_BY: Final = {
    "IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "LOOP": "ENDLOOP", "REPEAT": "UNTIL", "SWITCH": "ENDSWITCH",
}  # fmt: skip
HALT: Final = re.compile(r"\s*HALT\s*", _I)
BETWEEN: Final = re.compile(r"\s*(ELSE|CASE|DEFAULT|EXIT)\b", _I)
JUMP: Final = re.compile(r"\s*(GOTO\b|RESUME\b|RETURN\b|\w+\s*:\s*$)", _I)
PASSED: Final = re.compile(
    r"\s*(?:DECL\b|(?:GLOBAL\s+)?(?:INT|REAL|BOOL|CHAR|FRAME|POS|E6POS|AXIS|E6AXIS|SIGNAL|STRUC|ENUM|FDAT|LDAT|PDAT)\s"
    r"|EXT\b|EXTP\b|EXTFCT|IMPORT\b|GLOBAL\s+INTERRUPT\b|INTERRUPT\b|WAIT\s+FOR\b|WAIT\s*\(|HALT\s*$|CONTINUE\s*$"
    r"|PULSE\s*\(|BRAKE\b|ANOUT\b|ANIN\b|SYN\s+(?:OUT|PULSE)\b|ON_ERROR|ASYPTP\b)",
    _I,
)
ACTS: Final = re.compile(
    r"\s*(?:\$(?:OUT|ANOUT|FLAG|CYCFLAG)\b|PULSE\b|WAIT\s+FOR\b|WAIT\s*\(|HALT\b|SYN\b|ANOUT\b|TRIGGER\b"
    r"|(?:GLOBAL\s+)?INTERRUPT\b|BRAKE\b|ASYPTP\b|IF\b|SWITCH\b|FOR\b|WHILE\b|LOOP\b|REPEAT\b)",
    _I,
)
STANDARD: Final = re.compile(r"\s*(?:GLOBAL\s+INTERRUPT\s+DECL\s+3\s+WHEN\s+\$STOPMESS\b|INTERRUPT\s+ON\s+3\s*$)", _I)
"""The stop interrupt that every KUKA program sets up."""
ASSIGNMENT: Final = re.compile(rf"\s*({NAME})((?:\.\w+)*)\s*=.*", _I)
AXES: Final = re.compile(rf"\s*{NAME}\s*=\s*\{{\s*(?:(?:E6)?AXIS\s*:)?\s*A[1-6]\b", _I)
"""Axis angles that a name gets."""
CALL: Final = re.compile(r"\s*(\w+)\s*\(.*\)\s*", _I)
NO_ARGUMENTS: Final = re.compile(r"\s*\w+\s*\(\s*\)\s*", _I)


def subprograms(lines: Sequence[str]) -> dict[str, int]:
    """Lines (1-based) at which the routines of a file begin, by name in capitals, without the first one."""
    heads = [
        (match[1].upper(), at) for at, line in enumerate(lines, start=1) if (match := ROUTINE.fullmatch(code_of(line)))
    ]
    return dict(reversed(heads[1:]))
