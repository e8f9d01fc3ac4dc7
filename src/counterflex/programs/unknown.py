"""Values of a program that its text does not determine.

A person's input, an input signal, a sensor, the date: a reader keeps such a value as :class:`Unknown`, with the
statement that made it so. Arithmetic with an unknown value gives an unknown value. A statement that needs the number,
for a frame, tool, speed, override, orientation mode, displacement, target or branch, asks :func:`known` for it, which
refuses an unknown one and names both places.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from counterflex.core.errors import ProgramError

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Unknown:
    """A value that the text of a program does not determine."""

    why: str  # The cause, as a clause that follows a colon: ``a person enters it (TPReadNum)``
    where: str = ""  # ``file:line`` of the statement that made it unknown; empty where it was never set

    def __str__(self) -> str:
        return f"{self.why} in {self.where}" if self.where else self.why


def first_unknown(value: object) -> Unknown | None:
    """Return the first unknown value of a value, its components and elements included; None where all are known."""
    if isinstance(value, Unknown):
        return value
    if isinstance(value, str | bytes):
        return None
    items: Iterable[object] = ()
    if isinstance(value, Mapping):
        items = value.values()
    elif isinstance(value, list | tuple):
        items = value
    return next((unknown for item in items if (unknown := first_unknown(item)) is not None), None)


def known(value: T | Unknown, use: str, where: str, *, text: str = "", hint: str = "Write the value itself") -> T:
    """Return a value that a statement needs.

    Args:
        value: What the program has there.
        use: What it is needed for, with which the message begins: ``the path speed``.
        where: ``file:line:column`` of the statement that uses it.
        hint: What to do.

    Raises:
        ProgramError: It is unknown, or a component of it is; the message names where it became so.
    """
    unknown = first_unknown(value)
    if unknown is not None:
        raise ProgramError(
            f"{use} is not known: {unknown}", where=where, value=text.strip()[:60],
            limit="values that follow from the text of the program", hint=hint,
        )  # fmt: skip
    return value  # type: ignore[return-value]  # no Unknown is left
