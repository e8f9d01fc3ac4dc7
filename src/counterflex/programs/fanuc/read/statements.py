"""Statements of FANUC TP by what they are to a milling program."""

from __future__ import annotations

import re
from typing import Final

from counterflex.core.units import MM_PER_S
from counterflex.programs.robot_text.process_words import NUMBER

_I: Final = re.IGNORECASE
COMMENT: Final = re.compile(r"!|//|--")
POSITION: Final = re.compile(r"P\s*\[\s*(\d+)\s*(?::[^\]]*)?\]", _I)
MOTION: Final = re.compile(r"([JLCAS])\s+(?=P\s*R?\s*\[|@)", _I)
SPEED: Final = re.compile(rf"\s*({NUMBER})\s*(%|mm/sec|cm/min|inch/min|deg/sec|msec|sec)(?![A-Za-z/])", _I)
UNITS: Final = {"mm/sec": MM_PER_S, "cm/min": 10.0 * MM_PER_S / 60.0, "inch/min": 25.4 * MM_PER_S / 60.0}
"""Speeds along the path, m/s."""
TERMINATION: Final = re.compile(r"\s*(FINE|CNT\s*\d+|CD\s*\d+|CR\s*\d+(?:\.\d+)?)(?![A-Za-z0-9])", _I)
CARRIED: Final = re.compile(r"(?:ACC\s*\d+|PTH)(?![A-Za-z0-9])", _I)
"""Options of a motion that change neither its path nor its speed where that is constant."""
AT_TIME: Final = re.compile(r"(?:TA|TB|DB)\s*[-\d.]+\s*(?:sec|mm)?\s*,.*", _I | re.DOTALL)
"""Options that do something before or behind the end of a motion."""
USER_FRAME: Final = re.compile(r"UFRAME_NUM\s*=\s*(\d+)", _I)
USER_TOOL: Final = re.compile(r"UTOOL_NUM\s*=\s*(\d+)", _I)
WAIT_TIME: Final = re.compile(rf"WAIT\s+({NUMBER})\s*\(\s*sec\s*\)", _I)
OVERRIDE: Final = re.compile(r"OVERRIDE\s*=\s*(\d+)\s*%", _I)
OPENS: Final = re.compile(r"(IF\s*\(.*\)\s*THEN|IF\b.*\bTHEN|FOR\b.*|SELECT\b.*)", _I | re.DOTALL)
CLOSES: Final = re.compile(r"(ENDIF|ENDFOR)", _I)
CLOSED_BY: Final = {"IF": "ENDIF", "FOR": "ENDFOR"}
BETWEEN: Final = re.compile(r"ELSE", _I)
CONDITION: Final = re.compile(r"IF\b", _I)
MOVES: Final = re.compile(r"\b(JMP|CALL)\b", _I)
JUMP: Final = re.compile(r"(JMP\b|SELECT\b|WHEN\b|CASE\b)", _I)
CALL: Final = re.compile(r"(CALL|RUN)\b", _I)
ENDS: Final = re.compile(r"(END|ABORT)", _I)
PAUSE: Final = re.compile(r"PAUSE", _I)
ACTS: Final = re.compile(r"(DO|RO|GO|AO|SO|WO|UO|F|M)\s*\[|WAIT\b|PULSE\b|MONITOR\b|UALM\b", _I)
"""What acts on the cell, or waits for it."""
PASSED: Final = re.compile(
    r"(R|SR|AR|TIMER|PL)\s*\[|MESSAGE\s*\[|PAYLOAD\s*\[|LBL\s*\[|JOINT_MAX_SPEED\b|COL\s+(DETECT|GUARD)\b|LOCK\s+PREG"
    r"|UNLOCK\s+PREG|\$WAITTMOUT\b|ERROR_PROG\b|RESUME_PROG\b|DIAG_REC\b",
    _I,
)
"""What neither moves the robot nor acts on the cell."""
ASSIGNED: Final = re.compile(r"P\s*\[\s*(\d+)\s*(?:,[^\]]*)?\]\s*=", _I)
REGISTER: Final = re.compile(r"PR\s*\[", _I)
SHIFTS: Final = re.compile(
    r"(OFFSET\s+CONDITION|TOOL_OFFSET\s+CONDITION|VOFFSET|VISION|UFRAME\s*\[|UTOOL\s*\[|SKIP\s+CONDITION"
    r"|LINEAR_MAX_SPEED|SOFTFLOAT|TRACK|TOUCH|WEAVE|LINE\s+TRACKING|\$)",
    _I,
)
"""What changes where the robot goes, or how fast."""
EMPTY: Final = re.compile(r"\s*")
EXACT: Final = re.compile(r"FINE|CNT\s*0+", _I)
