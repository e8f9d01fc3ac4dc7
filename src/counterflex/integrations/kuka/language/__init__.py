"""KUKA KRL: compensated programs, and programs whose path RSI corrects."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits

TIMER: Final = 20
"""Number of the timer that waits use."""
LIMITS: Final = Limits(
    line_characters=255,
    name_characters=24,
    points_per_file=5_000,
    position_decimals=4,
    angle_decimals=5,
    source="names: 24 characters (KUKA KRL manual); points per file: no published figure, long programs are split in "
    "practice (cautious)",
)


def krl_wait(condition: str, limit_s: float, fault: str) -> list[str]:
    """KRL that waits for a condition and halts, again and again, where it does not hold in time.

    Args:
        condition: KRL expression.
        limit_s: Time until it halts, s.
        fault: Said in the line that halts.
    """
    return [
        f"$TIMER_STOP[{TIMER}]=TRUE",
        f"$TIMER[{TIMER}]=0",
        f"$TIMER_STOP[{TIMER}]=FALSE",
        f"WHILE NOT ({condition})",
        f"IF $TIMER[{TIMER}]>{limit_s * 1000.0:.0f} THEN",
        f"HALT ; {fault}",
        "ENDIF",
        "WAIT SEC 0.012",
        "ENDWHILE",
    ]


LANGUAGE: Final = Language(
    title="KUKA KRL",
    short="KRL",
    endings=(".src",),
    signs=Signs(
        "KUKA KRL",
        (
            r"^&(ACCESS|REL|PARAM|COMMENT)\b",
            r"^;FOLD\b",
            r"^(GLOBAL\s+)?DEF\s+\w+$",
            r"^(GLOBAL\s+)?DEF(FCT|DAT)\s+\w+",
            r"^S?(PTP|LIN|CIRC)(_REL)?\s+[{A-Z]\w*",
            r"^\$(VEL|ACC|APO|TOOL|BASE|OV_PRO|IPO_MODE)\b",
            r"^BAS\s*\(",
        ),
        (r"^DECL\s+\w+", r"^HALT$", r"^WAIT (SEC|FOR)\b", r"^END$"),
        "KRL is read by its suffix: name the file NAME.src, with NAME.dat beside it",
    ),
    limits=LIMITS,
    forms=StatementForms(
        lambda why: [f"HALT ; {why}"], "WAIT SEC {}", krl_wait, ("WAIT SEC 0.0",), ";",
        "$OUT[17]=TRUE", "$OUT[{p}]=TRUE", "tool_data",
    ),
    waits=re.compile(r"\s*(?:HALT\b|WAIT\s+FOR\b(?!\s*\(?\s*TRUE\s*\)?\s*(?:;|$)))", re.IGNORECASE),
    comment=re.compile(r"^\s*;(?!\s*(?:END)?FOLD|FOLD|ENDFOLD)(.*)", re.IGNORECASE),
    read="counterflex.integrations.kuka.language.read.reader:read_krl_file",
    files="counterflex.integrations.kuka.language.read.reader:job_files",
    table="counterflex.integrations.kuka.language.read.table:TABLE",
    doubts="counterflex.integrations.kuka.language.read.reader:corrected_by_sensor",
    cell="counterflex.integrations.kuka.language.job:cell_of",
    in_place="counterflex.integrations.kuka.language.in_place:write_krl_in_place",
    write="counterflex.integrations.kuka.language.job:write",
    convert="counterflex.integrations.kuka.language.job:convert",
    load="counterflex.integrations.kuka.language.job:load",
)  # fmt: skip
"""``WAIT FOR TRUE`` only stops the advance run: no wait."""
