"""Statements that writers add themselves, in each language of robots: stops for a person, pauses, waits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class StatementForms:
    """Statements of a language, one a line, without line numbers."""

    stop: Callable[[str], list[str]]  # Stops for a person, with what he is told
    pause: str  # Waits; ``{}`` is the time in s
    # Waits until a condition holds: condition, longest time in s, what is said where it does not hold
    until: Callable[[str, float, str], list[str]]
    in_place: tuple[str, ...]  # Before a machine function: makes a controller that runs ahead of the motion wait for it
    comment: str  # What begins a comment
    output: str  # An output that is set, as an example
    output_of_word: str  # The same by the P word of an M-code
    data_key: Literal["tool_data", "tooldata"]  # Key of ``[[tools]]`` that names the tool frame on the controller
    end: str = ""  # What every statement of the cell file's table ends in, and no condition has; empty where nothing
