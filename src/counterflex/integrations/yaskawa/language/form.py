"""The text of a motion of INFORM: position, speed and options, each with its place."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from counterflex.core.units import MM
from counterflex.integrations.yaskawa.language.source import InformJob, InformStatement
from counterflex.integrations.yaskawa.language.table import OPTION, TABLE
from counterflex.integrations.yaskawa.language.values import VARIABLE
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.robot_text.program import Span
from counterflex.programs.statement_table import Treatment

_I: Final = re.IGNORECASE
MOTION: Final = re.compile(r"(MOV[JLC]|IMOV)(?![A-Za-z0-9])\s*", _I)
FRAME: Final = r"BF|RF|TF|UF#\(\d{1,3}\)"
_VALUE: Final = rf"(?:{NUMBER}|{VARIABLE})"
_TOKEN: Final = re.compile(
    rf"(?:(?P<target>C\d{{1,6}}|L?PX?(?:\d{{1,5}}|\s*\[[^\]]*\]))|(?P<other>(?:BC|EC|L?BP|L?EX)(?:\d{{1,6}}|\[[^\]]*\]))"
    rf"|V=(?P<speed>{_VALUE})|VJ=(?P<percent>{_VALUE})|PL=(?P<level>{_VALUE})|CR=(?P<radius>{NUMBER})"
    rf"|(?P<frame>{FRAME})|(?P<fpt>FPT)|(?P<carried>(?:ACC|DEC|COORD|SPDL)={_VALUE}|NWAIT"
    rf"|ENWAIT(?:\s+(?:T|DIS)={_VALUE})?))(?=\s|$)\s*",
    _I,
)
_REFUSED: Final = {
    row.word.removeprefix(OPTION).upper(): row.reason
    for row in TABLE.of(Treatment.REFUSED)
    if row.word.startswith(OPTION)
}


@dataclass(frozen=True, slots=True)
class Form:
    """A motion as written; places are those in the instruction."""

    word: str  # ``MOVJ MOVL MOVC IMOV``
    target: str = ""  # Name of its position; empty where it names none
    named: Span = (0, 0)  # Where that stands
    words: str = ""  # Names of positions of external axes, as written
    speed: str = ""  # Text of ``V=``; empty without one
    number: Span = (0, 0)  # Where that text stands
    level: int = -1  # Of ``PL=``; -1 where it is not said, or by a variable
    rounding_m: float = float("nan")  # Of ``CR=``; NaN without one
    frame: str = ""  # Of an increment: ``BF``, ``RF``, ``TF``, ``UF#(1)``
    fpt: bool = False  # The arc changes here
    tail: str = ""  # Options behind the speed

    @property
    def exact(self) -> bool:
        """The robot stops at its end."""
        return self.level == 0


def form_of(job: InformJob, statement: InformStatement, match: re.Match[str]) -> Form:
    """Divide a motion.

    Raises:
        ProgramError: It is not understood, or has an option that is not read.
    """
    code, at = statement.code, match.end()
    parts: dict[str, re.Match[str]] = {}
    others: list[str] = []
    tail: list[str] = []
    while at < len(code):
        token = _TOKEN.match(code, at)
        if token is None or token.lastgroup is None:
            _refuse(job, statement, at)
        elif token.lastgroup == "other":
            others.append(token["other"])
        elif token.lastgroup == "carried":
            tail.append(token[0].strip())
        elif token.lastgroup in parts:
            raise job.fault(statement.start + at, "a part of a motion is there twice", "once")
        else:
            parts[token.lastgroup] = token
            if token.lastgroup in ("level", "radius"):
                tail.append(token[0].strip())
        at = code_end(token)
    texts = {key: token[key] for key, token in parts.items()}
    level = texts.get("level", "")
    if level.isdecimal() and int(level) > 8:
        raise job.fault(statement.start + parts["level"].start(), "there is no such position level", "PL=0 to PL=8")
    return Form(
        match[1].upper(), texts.get("target", ""), _span(parts.get("target"), "target", match.end()), " ".join(others),
        texts.get("speed", ""), _span(parts.get("speed"), "speed", match.end()),
        int(level) if level.isdecimal() else -1, float(texts.get("radius", "nan")) * MM,
        texts.get("frame", "").upper(), "fpt" in parts, " ".join(tail),
    )  # fmt: skip


def code_end(token: re.Match[str] | None) -> int:
    """Return the index behind a token; a missing one has been refused."""
    return 0 if token is None else token.end()


def _span(token: re.Match[str] | None, group: str, otherwise: int) -> Span:
    return (otherwise, otherwise) if token is None else token.span(group)


def _refuse(job: InformJob, statement: InformStatement, at: int) -> None:
    rest = statement.code[at:].upper()
    reason = next((why for word, why in _REFUSED.items() if rest.startswith(word)), "")
    raise job.fault(
        statement.start + at, f"an option of a motion that is not read{': ' if reason else ''}{reason}",
        "V, VJ, PL, CR, ACC, DEC, NWAIT, ENWAIT, FPT, COORD", "Post the path without it",
    )  # fmt: skip
