"""Statements that writers add themselves, in each language of robots: stops for a person, pauses, waits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class StatementForms:
    """Statements of a language, one a line, without line numbers.

    Attributes:
        stop: Stops for a person, with what he is told.
        pause: Waits; ``{}`` is the time in s.
        until: Waits until a condition holds: condition, longest time in s, what is said where it does not hold.
        in_place: Before a machine function: makes a controller that runs ahead of the motion wait for it.
        comment: What begins a comment.
        output: An output that is set, as an example.
        output_of_word: The same by the P word of an M-code.
        data_key: Key of ``[[tools]]`` that names the tool frame on the controller.
        end: What every statement of the cell file's table ends in, and no condition has; empty where nothing.
    """

    stop: Callable[[str], list[str]]
    pause: str
    until: Callable[[str, float, str], list[str]]
    in_place: tuple[str, ...]
    comment: str
    output: str
    output_of_word: str
    data_key: Literal["tool_data", "tooldata"]
    end: str = ""
