"""Which language a text is that is no G-code: robots, other controls, files of CAM systems, told by words of their own.

Only asked when a text could not be read as G-code, so a program that can be read is never accused of another language.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

_LOOKED_AT: Final = 120
"""Lines that are not empty, from the first one on."""
_POST: Final = "Post the tool path as three-axis G-code (a post for LinuxCNC fits)"
_LANGUAGE: Final = "Read it as what it is: --dialect {0}, or give the file the ending {1}"
_UNROLL: Final = "Post it without macros, cycles and frames of this control, as plain three-axis G-code"


@dataclass(frozen=True)
class Foreign:
    """A language that was recognised.

    Attributes:
        name: As people call it.
        line: 1-based line that tells it.
        text: What stands there.
        hint: What to do.
    """

    name: str
    line: int
    text: str
    hint: str


@dataclass(frozen=True)
class _Signs:
    """What tells a language: one ``sure`` line is enough, ``likely`` ones must be two of different form."""

    name: str
    hint: str
    sure: tuple[str, ...]
    likely: tuple[str, ...] = ()


def _robot(name: str) -> str:
    return f"Give the G-code that it was made from, or post the tool path as G-code. {name} is not read"


_LANGUAGES: Final = (
    _Signs(
        "a cell file of counterflex",
        "Give the program first and the cell file with --cell",
        (r'^format\s*=\s*"counterflex-',),
    ),
    _Signs(
        "KUKA KRL",
        "KRL is read by its suffix: name the file NAME.src, with NAME.dat beside it",
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
    ),
    _Signs(
        "ABB RAPID",
        "RAPID is read by its suffix: name the file NAME.mod",
        (
            r"^%%%",
            r"^MODULE\s+\w+",
            r"^(LOCAL\s+)?PROC\s+\w+$",
            r"^Move(L|J|C|AbsJ)\s+[\[\w*]",
            r"^(LOCAL\s+|TASK\s+)?(PERS|CONST|VAR)\s+\w+\s+\w+",
        ),
        (r"^ENDPROC$", r"^ENDMODULE$", r"^WaitTime\b", r"^Set(DO|AO)\b"),
    ),
    _Signs(
        "a FANUC robot program (LS)",
        _LANGUAGE.format("fanuc", ".ls"),
        (r"^/(PROG|ATTR|APPL|MN|POS)\b",),
        (r"^\d+:\s*[JLC]\s+P\[",),
    ),
    _Signs("Yaskawa INFORM", _robot("It"), (r"^/JOB$", r"^//(NAME|POS|INST)\b"), (r"^MOV[JLC]\s+C\d+", r"^NOP$")),
    _Signs(
        "Staubli VAL 3",
        _LANGUAGE.format("val3", ".pgx"),
        (r"staubli\.com/robotics/VAL3", r"^(movel|movej|movec)\s*\(\s*\w+\s*,\s*\w+\s*,\s*\w+\s*\)"),
        (r"^begin$", r"^waitEndMove\b"),
    ),
    _Signs(
        "Universal Robots script",
        _robot("It"),
        (r"^def\s+\w+\s*:$", r"^move[lpjc]\s*\(?\s*p\["),
        (r"^move[lpjc]$", r"^end$"),
    ),
    _Signs(
        "Kawasaki AS or Adept V+", _robot("It"), (r"^\.PROGRAM\b", r"^\.(TRANS|JOINTS|REALS)$"), (r"^L(MOVE|APPRO)\b",)
    ),
    _Signs("Comau PDL2", _robot("It"), (r"^PROGRAM\s+\w+", r"^MOVE\s+(LINEAR|JOINT|CIRCULAR)\b"), (r"^ROUTINE\s+\w+",)),
    _Signs("Mitsubishi MELFA BASIC", _robot("It"), (r"^(\d+\s+)?Mv[scr]\s+P", r"^(\d+\s+)?(Ovrd|Spd|Servo)\s+\w+")),
    _Signs(
        "Heidenhain conversational",
        _POST,
        (r"^(\d+\s+)?(BEGIN|END) PGM\b", r"^\d+\s+(TOOL CALL|TOOL DEF|BLK FORM|CYCL DEF|CALL LBL|LBL)\b"),
        (r"^(\d+\s+)?L\s+[XYZ][+-]", r"^(\d+\s+)?CC\s+[XYZ]", r"\bFMAX\b", r"\bFN\s*\d+:"),
    ),
    _Signs("Heidenhain ISO", _POST, (r"^%\S+\s+G7[01]\s*\*$",), (r"^N\d+\s.*\*$", r"\bG99\s+T\d", r"\bG7[01]\s*\*$")),
    _Signs(
        "Okuma OSP",
        _UNROLL,
        (r"^\$\S+\.(MIN|SSB|SUB|LIB)%?$", r"\bVC\d+\s*=", r"\bVZOF", r"\bG15\s*H\d", r"\bNCYL\b", r"\bG116\s*T\d"),
        (r"\bCALL\s+O\w+", r"\bGOTO\s+N\w+", r"^(N\d+\s*)?IF\s*\[", r"\bRTS\b", r"\bMODIN\b", r"\bG56\s*H\d"),
    ),
    _Signs(
        "Sinumerik",
        _LANGUAGE.format("sinumerik", ".mpf"),
        (
            r"^;\$PATH=",
            r"^%_N_",
            r"\bCYCLE\d{2,4}\b",
            r"\bT\s*=\s*\"",
            r"\b(TRAORI|TRANSMIT|TRACYL|TRAFOOF|SUPA|STOPRE|FFWON|COMPCAD|COMPCURV)\b",
            r"\bWORKPIECE\b",
            r"^(N\d+\s*)?A?(TRANS|ROT|MIRROR|SCALE)(\s|$)",
            r"^(N\d+\s*)?DEF\s+(REAL|INT|BOOL|STRING|AXIS|CHAR|FRAME)\b",
            r"^(N\d+\s*)?MSG$",
            r"\bCR\s*=",
            r"^(N\d+\s*)?PROC\s+\w+.*(SAVE|DISPLOF|SBLOF)",
        ),
        (
            r"\b[XYZABCIJKFSR]\s*=",
            r"\bR\d+\s*=",
            r"\bGOTO[FB]\b",
            r"^(N\d+\s*)?(IF|ENDIF|ELSE|FOR|ENDFOR|WHILE|ENDWHILE)\b",
        ),
    ),
    _Signs("Fagor", _UNROLL, (r"^%\w+\s*,\s*MX", r"^#(TSAFE|HSC|TANGCTRL|RTCP|CS|ACS)\b", r"^\$(IF|WHILE|FOR|GOTO)\b")),
    _Signs("NUM", _UNROLL, (r"\bG7[79]\s*[NH]\d", r"\bG997\b"), (r"\bL\d+\s*=", r"\bE\d{5}\s*=")),
    _Signs(
        "an APT or CL file of a CAM system",
        _LANGUAGE.format("apt", ".apt"),
        (
            r"^(PARTNO|PPRINT|MACHIN|FEDRAT|CUTTER|LOADTL|SPINDL|COOLNT|MULTAX|TOOL PATH|TLDATA|CUTCOM|UNITS|CATIA0)"
            r"(\s*/|\s|$)",
            r"^(GOTO|RAPID|CIRCLE|GODLTA|FROM)\s*/",
            r"^\$\$",
        ),
        (r"^RAPID$", r"^FINI$", r"^END-OF-PATH$"),
    ),
    _Signs("STEP (ISO 10303-21)", _POST, (r"^ISO-10303-21",)),
    _Signs("a drawing (DXF)", _POST, (r"^SECTION$",), (r"^HEADER$", r"^ENTITIES$", r"^EOF$")),
    _Signs("a mesh (STL)", _POST, (r"^solid(\s|$)",), (r"^facet normal\b", r"^outer loop$")),
    _Signs("HPGL", _POST, (r"^IN;.*(SP|PU|PA)\d",)),
    _Signs("a web page or XML", "Give the file itself, not a page that shows it", (r"^<(\?xml|!DOCTYPE|html)\b",)),
)
_COMMENT: Final = re.compile(r"\([^()]*\)")
_COMPILED: Final = tuple(
    (
        signs,
        tuple(re.compile(sign, re.IGNORECASE) for sign in signs.sure),
        tuple(re.compile(sign, re.IGNORECASE) for sign in signs.likely),
    )
    for signs in _LANGUAGES
)


def foreign_language(lines: Sequence[str]) -> Foreign | None:
    """Recognise a text that is no G-code.

    Args:
        lines: Of the text, without line ends.

    Returns:
        The language, or None where nothing tells it.
    """
    shown = list(_shown(lines))
    for signs, sure, likely in _COMPILED:
        for number, text in shown:
            if any(sign.search(text) for sign in sure):
                return Foreign(signs.name, number, text[:60], signs.hint)
        match = [next((item for item in shown if sign.search(item[1])), None) for sign in likely]
        hits = sorted(item for item in match if item is not None)
        if len(hits) > 1:
            return Foreign(signs.name, hits[0][0], hits[0][1][:60], signs.hint)
    return None


def _shown(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """First lines that are not empty, each with its number, without what G-code takes for a comment."""
    count = 0
    for number, line in enumerate(lines, start=1):
        text = _COMMENT.sub(" ", line.lstrip("\ufeff")).strip()
        if not text.startswith((";FOLD", ";$PATH")):
            text = text.split(";")[0].strip() if not text.upper().startswith("IN;") else text
        if not text:
            continue
        yield number, text
        count += 1
        if count == _LOOKED_AT:
            return
