"""A program that was written in parts as one text again, so that it can be read back as a whole."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from counterflex.programs.fanuc.read.listing import Listing

_PROC: Final = re.compile(r"^  PROC .*?^  ENDPROC\n", re.DOTALL | re.MULTILINE)
_BODY: Final = re.compile(r"begin\n(.*)end\n", re.DOTALL)
_NUMBERED: Final = re.compile(r"\bP\[(\d+)\]")


def joined(files: Mapping[str, str], language: str) -> dict[str, str]:
    """Files with all parts within the main one.

    Args:
        files: As written, the main program first.
        language: Dialect.

    Returns:
        The main program with its parts, and the data that belongs to it.
    """
    (main, text), *others = files.items()
    suffix = main[main.rindex(".") :]
    parts = {name[: -len(suffix)]: part for name, part in others if name.endswith(suffix)}
    if not parts:
        return dict(files)
    stem = main[: -len(suffix)]
    if language == "krl":
        text += "".join(
            "".join(f"{line}\n" for line in part.splitlines() if line[:1] != "&") for part in parts.values()
        )
    elif language == "rapid":
        routines = "".join(match[0] for part in parts.values() for match in _PROC.finditer(part))
        text = text.replace("ENDMODULE\n", f"{routines}ENDMODULE\n")
    elif language == "fanuc":
        text = _fanuc(text, {name.upper(): part for name, part in parts.items()})
    elif language == "val3":
        text = re.sub(r"^  call (\w+)\(\)\n", lambda match: _BODY.findall(parts[match[1]])[0], text, flags=re.MULTILINE)
    return {main: text} | {name: data for name, data in others if name.startswith(f"{stem}.")}


def _fanuc(main: str, parts: Mapping[str, str]) -> str:
    """Statements of the parts in place of their calls, positions numbered through."""
    statements: list[str] = []
    entries: list[str] = []
    offset = 0
    listing = Listing(main, "main", complete=True)
    for statement in listing.statements():
        called = statement.code.removeprefix("CALL ").strip().upper()
        if called not in parts:
            statements.append(statement.code)
            continue
        part = Listing(parts[called], called, complete=True)
        shift = offset

        def moved(text: str, shift: int = shift) -> str:
            return _NUMBERED.sub(lambda match: f"P[{int(match[1]) + shift}]", text)

        positions = part.positions()
        statements += [moved(one.code) for one in part.statements()]
        entries += [moved(part.text[one.start : one.end]) for one in positions.values()]
        offset += len(positions)
    lines = "".join(f":{code};\n" for code in statements)
    return "\n".join(["/PROG main", "/MN", lines + "/POS", *entries, "/END", ""])
