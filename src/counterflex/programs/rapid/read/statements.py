"""Statements of RAPID by what they are to a milling program."""

from __future__ import annotations

import re
from typing import Final

_I: Final = re.IGNORECASE
MODULE: Final = re.compile(r"MODULE\s+(\w+)", _I)
ROUTINE: Final = re.compile(
    r"(?:(?:LOCAL|TASK|GLOBAL)\s+)?(PROC|FUNC|TRAP|RECORD)\s+(?:\w+\s+(?=\w+\s*\())?(\w+)\s*(\(.*\))?", _I | re.DOTALL
)
END_OF: Final = {"PROC": "ENDPROC", "FUNC": "ENDFUNC", "TRAP": "ENDTRAP", "RECORD": "ENDRECORD"}
OPENS: Final = {"IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "TEST": "ENDTEST"}
BETWEEN: Final = frozenset(("ELSE", "ELSEIF", "CASE", "DEFAULT"))
HANDLERS: Final = frozenset(("ERROR", "UNDO", "BACKWARD"))
MOTIONS: Final = {"MOVEJ": 4, "MOVEL": 4, "MOVEC": 5}
"""Number of arguments by word."""
BY_AXES: Final = frozenset(("MOVEABSJ",))
OTHER_MOTION: Final = re.compile(
    r"(MOVE\w+|TRIGG\w+|SEARCH\w+|EGM\w+|CORR\w+|ARC\w+|MOVEEXTJ|SPOT\w+|DISP\w+|PAINT\w+)$", _I
)
SPEED_OVERRIDE: Final = re.compile(r"VELSET\s+([\d.]+)\s*,\s*([\d.]+)\s*", _I)
WAIT_TIME: Final = re.compile(r"WAITTIME\s+(?:\\INPOS\s*,?\s*)?(.+?)\s*", _I | re.DOTALL)
ASSIGNMENT: Final = re.compile(r"([A-Za-z]\w*)\s*(?:\{[^}]*\}|\.\w+)*\s*:=", _I)
COMPACT_IF: Final = re.compile(r"IF\b", _I)
MOVES: Final = re.compile(r"\b(MOVE\w+|TRIGG\w+|SEARCH\w+|EGM\w+)\b", _I)
ACTS: Final = frozenset((
    "SET", "RESET", "SETDO", "SETAO", "SETGO", "PULSEDO", "INVERTDO", "WAITDI", "WAITDO", "WAITAI", "WAITAO",
    "WAITGI", "WAITGO", "WAITUNTIL", "TPREADFK", "TPREADNUM", "UIMSGBOX", "CONNECT", "IDELETE", "IDISABLE",
    "IENABLE", "ISIGNALDI", "ISIGNALDO", "ISIGNALAI", "ISIGNALAO", "ITIMER", "IWATCH", "ISLEEP",
))  # fmt: skip
"""Instructions that act on the cell, or wait for it."""
PASSED: Final = frozenset((
    "TPWRITE", "TPERASE", "TPSHOW", "ERRWRITE", "CLKRESET", "CLKSTART", "CLKSTOP", "CONFL", "CONFJ", "SINGAREA",
    "ACCSET", "WORLDACCLIM", "PATHACCLIM", "CIRPATHMODE", "PATHRESOL", "GRIPLOAD", "WAITROB", "MOTIONSUP", "INCR",
    "DECR", "CLEAR", "ADD", "OPEN", "CLOSE", "WRITE", "PDISPOFF", "EOFFSOFF",
))  # fmt: skip
"""Instructions that neither move the robot nor act on the cell."""
DISPLACES: Final = frozenset(("PDISPSET", "PDISPON", "EOFFSSET", "EOFFSON", "SOFTACT", "SPEEDREFRESH"))
ENDS: Final = frozenset(("EXIT", "STOP", "BREAK", "RETURN", "RAISE", "RETRY", "TRYNEXT", "GOTO", "EXITCYCLE"))
CALL: Final = re.compile(r"([A-Za-z]\w*)\s*", _I)
