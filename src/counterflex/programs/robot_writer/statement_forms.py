"""How each language of robots says what writers add themselves: stops for a person, pauses, waits for a condition."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

Dialect = Literal["krl", "rapid", "fanuc", "val3"]
TIMER: Final = 20
"""Number of the KRL timer that waits use."""


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
    """

    stop: Callable[[str], list[str]]
    pause: str
    until: Callable[[str, float, str], list[str]]
    in_place: tuple[str, ...]
    comment: str
    output: str
    output_of_word: str
    data_key: Literal["tool_data", "tooldata"]


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


def _fanuc_remark(why: str) -> str:
    """A remark has 32 characters on a FANUC controller."""
    short = why.replace(", then press start", "").replace(" counter-clockwise", " (M4)")
    return short.replace("start the spindle", "start spindle")


FORMS: Final[dict[Dialect, StatementForms]] = {
    "krl": StatementForms(
        lambda why: [f"HALT ; {why}"], "WAIT SEC {}", krl_wait, ("WAIT SEC 0.0",), ";",
        "$OUT[17]=TRUE", "$OUT[{p}]=TRUE", "tool_data",
    ),
    "rapid": StatementForms(
        lambda why: [f'TPWrite "{why}";', "Stop;"], "WaitTime {};",
        lambda condition, limit_s, _: [f"WaitUntil {condition}\\MaxTime:={limit_s:g};"], (), "!",
        "SetDO doSpindle,1;", "SetDO do{p},1;", "tooldata",
    ),
    "fanuc": StatementForms(
        lambda why: [f"!{_fanuc_remark(why)}", "PAUSE"], "WAIT {}(sec)",
        lambda condition, _limit_s, _fault: [f"WAIT {condition}"], (), "!",
        "DO[17]=ON", "DO[{p}]=ON", "tool_data",
    ),
    "val3": StatementForms(
        lambda why: ["userPage()", f'putln("{why}")', "get()"], "delay({})",
        lambda condition, _limit_s, _fault: [f"wait({condition})"], ("waitEndMove()",), "//",
        "dioSpindle=true", "dio{p}=true", "tooldata",
    ),
}  # fmt: skip
"""By language. FANUC and VAL3 wait for a condition without a limit: ``controller.spindle.wait_s`` is not in them."""
