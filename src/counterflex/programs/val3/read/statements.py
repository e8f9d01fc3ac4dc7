"""Statements of VAL3 by what they are to a milling program; words tell capitals apart."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.robot_text.process_words import NUMBER

MOTION: Final = re.compile(r"(?:[A-Za-z_]\w*(?:\[\d+\])?\s*=\s*)?(movej|movel|movec)\s*\(")
OTHER_MOTION: Final = re.compile(r"(?:\w+\s*=\s*)?(moves?\w*|alter\w*|jointMove|compliance\w*)\s*\(")
ARGUMENTS: Final = {"movej": 3, "movel": 3, "movec": 4}
WAIT_END: Final = re.compile(r"waitEndMove\s*\(\s*\)")
DELAY: Final = re.compile(rf"delay\s*\(\s*({NUMBER})\s*\)")
SPEED: Final = re.compile(rf"([A-Za-z_]\w*(?:\s*\[\s*\d+\s*\])?)\s*\.\s*tvel\s*=\s*({NUMBER})")
FIELD: Final = re.compile(r"([A-Za-z_]\w*)(?:\s*\[[^\]]*\])?\s*(?:\.\s*\w+)+\s*=")
ASSIGNMENT: Final = re.compile(r"([A-Za-z_]\w*)(?:\s*\[[^\]]*\])?\s*=(?!=)")
OUTPUT: Final = re.compile(r"(dio|aio|sio|d[A-Z]|do|ao|out)\w*(?:\s*\[[^\]]*\])?\s*=", re.IGNORECASE)
OPENS: Final = re.compile(r"(if|while|for|switch|do)\b")
CLOSED_BY: Final = {"if": "endIf", "while": "endWhile", "for": "endFor", "switch": "endSwitch", "do": "until"}
CLOSES: Final = re.compile(r"(endIf|endWhile|endFor|endSwitch|until)\b")
BETWEEN: Final = re.compile(r"(else|elseIf|case|default|break)\b")
CALL: Final = re.compile(r"call\s+")
RETURN: Final = re.compile(r"return\b")
KEY: Final = re.compile(r"get\s*\(\s*\)")
"""Waits for a key of the operator: the stop that counterflex writes."""
ACTS: Final = re.compile(r"(open|close|wait|aioSet|dioSet|setDout|setAio|ioBusStatus|taskSuspend|get)\s*\(")
"""What acts on the cell, or waits for it."""
PASSED: Final = re.compile(
    r"(put|putln|popUpMsg|logMsg|cls|userPage|title|gotoxy|resetMotion|autoConnectMove|setMoveId|enablePower|clearBuffer"
    r"|setMonitorSpeed|restartMove)\s*\("
)
"""What neither moves the robot nor acts on the cell. Monitor speed is the operator's."""
SHIFTS: Final = re.compile(r"(setFrame|setTool|link|setLatch|tool|disablePower|stopMove|resetTurn)\s*\(")
"""What changes where the robot goes, or whether."""
