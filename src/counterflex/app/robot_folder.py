"""What making a robot's files has in common, whatever the protocol: its programs read, errors refused, a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.file_content import content
from counterflex.core.next_command import next_command
from counterflex.core.registry import Registry
from counterflex.files.summary_file import write_summary
from counterflex.protocols.finding import Finding

_ENCODING: Final = "latin-1"


def read_program(path: Path, suffixes: tuple[str, ...], what: str, language: str) -> str:
    """Text of a robot program, byte for byte.

    Args:
        suffixes: Lower-case endings that it may have; the first is named.
        what: For example ``KRL program``.
        language: As ``compensate --as`` calls it.

    Raises:
        ProgramError: Another ending, or no text.
    """
    if path.suffix.lower() not in suffixes:
        raise ProgramError(
            f"not a {what}",
            where=str(path),
            limit=f"a {suffixes[0]} file",
            hint=f"{next_command('compensate', 'PROGRAM', cell='CELL', as_=language, out='DIR')} writes one",
        )
    data = content(path)
    if b"\0" in data:
        raise ProgramError("not a text", where=str(path))
    return data.decode(_ENCODING)


def require_other_folder(out: str | Path, program: Path | None) -> None:
    """Check that what is written does not lie over the program that it is made of.

    Raises:
        InputError: The folder is the program's own.
    """
    if program is not None and Path(out).resolve() == program.resolve().parent:
        raise InputError(
            "the program would be written over by itself with the correction in it",
            where="--out",
            value=str(out),
            limit=f"another folder than that of {program.name}",
            hint="Name another folder, for example robot",
        )


def refuse_errors(findings: Iterable[Finding]) -> None:
    """Refuse to write what has a finding of severity error. Raises InputError: the first of them."""
    bad = next((item for item in findings if item.severity == "error"), None)
    if bad is not None:
        raise InputError(bad.what, where=bad.where, value=bad.value, limit=bad.safe, hint=bad.hint)


def unwatched(output: int | str | None, key: str) -> tuple[str, ...]:
    """What to say where no output of the controller tells a safety PLC that the correction may act.

    Args:
        output: The output, or None.
        key: Key of the table ``[controller]`` that names it.
    """
    if output is not None:
        return ()
    return (
        f"warning: no output shows a safety PLC that the correction may act; set controller.{key} in the cell file",
    )


def write_folder(
    out: str | Path, programs: Mapping[str, str], texts: Mapping[str, str], summary: Mapping[str, Any]
) -> None:
    """Write programs as they were read, other texts and ``summary.json``, all of them or none.

    Args:
        texts: By file name, UTF-8.
    """
    with atomic.atomic_folder(out) as staging:
        for name, text in texts.items():
            atomic.write_text(staging / name, text)
        for name, text in programs.items():
            atomic.write_bytes(staging / name, text.encode(_ENCODING))
        write_summary(staging / "summary.json", dict(summary))


@dataclass(frozen=True)
class RobotSetup:
    """Files that connect a controller to the loop."""

    title: str
    check: Callable[..., tuple[Finding, ...]]  # Findings in files that are there, by the settings of ``check``
    # Files for a cell into a folder: the folder, and by name the settings of ``make``
    make: Callable[..., dict[str, Any]]


SETUPS: Final[Registry[RobotSetup]] = Registry(
    "counterflex.robot_setups", "set-up of a controller", "counterflex.app.robot_folder:RobotSetup"
)
