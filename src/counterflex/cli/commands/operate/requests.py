"""Requests of the operator to a run that goes on, done without the command parser: a stop may not wait for it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

_ACTIONS: Final = ("status", "stop", "reset", "arm")


def quick(words: Sequence[str]) -> int | None:
    """Do a request of the operator at once, past the command parser, which takes longer to load than a stop may take.

    Returns:
        Exit status; None where this is no plain request, so that the parser has to look at it.
    """
    plain = [word for word in words[2:] if word != "--json"]
    if words[:1] != ["operator"] or len(words) < 2 or words[1] not in _ACTIONS or len(plain) != 1:
        return None
    if plain[0].startswith("-") or len(words) - 2 - len(plain) > 1:
        return None
    return send_request(Path(plain[0]), words[1], as_json="--json" in words[2:])


def send_request(log: Path, action: str, *, as_json: bool) -> int:
    """Ask something of a run and print the answer.

    Args:
        action: ``status``, ``stop``, ``reset`` or ``arm``.

    Returns:
        Exit status: 1 where it was refused.

    Raises:
        CounterflexError: No run goes on there, or it does not answer.
    """
    from counterflex.app.run.operator_requests import request

    reply = request(log, action)
    if as_json:
        import json

        print(json.dumps(reply, indent=2, allow_nan=False))
    else:
        cause = "" if reply["cause"] == "none" else f" ({reply['cause'].replace('_', ' ')})"
        feed = ", feed held" if reply["feed_hold"] else ""
        robot = "" if reply["robot_heard"] else ", no telegram yet"
        print(f"{reply['state'].replace('_', ' ')}{cause}, correction {reply['correction_mm']:.3f} mm{feed}{robot}")
        if action == "status":
            for line in _seen(reply):
                print(line)
        if not reply["done"]:
            print(f"{action} refused: {reply['refused']}", file=sys.stderr)
    return int(not reply["done"])


def _seen(reply: dict[str, Any]) -> list[str]:
    """Return what else is to be seen of a run: place, force, how old each source is, strangers, losses."""
    lines = []
    if reply["place"] is not None:
        lines.append(f"place: {100.0 * reply['place']:.1f} % of the plan")
    force = [
        f"{reply[key]:.0f} N {word}"
        for key, word in (("force_n", "measured"), ("planned_n", "planned"))
        if reply[key] is not None
    ]
    if force:
        lines.append("force: " + ", ".join(force))
    ages = [f"{name} {'nothing yet' if age is None else f'{age:.0f} ms'}" for name, age in reply["age_ms"].items()]
    lines.append("age: " + ", ".join(ages))
    if reply.get("tracker_off") is not None:
        from counterflex.protocols.session.tracker_off import offset_message

        lines.append(offset_message(reply["tracker_off"]))
    lines.append(f"foreign telegrams dropped: {reply['foreign']}")
    lost = f" ({reply['log_trouble']})" if reply["log_trouble"] else ""
    lines.append(
        f"{'LOGGING STOPPED, ' if lost or reply['records_lost'] else ''}records lost: {reply['records_lost']}{lost}"
    )
    return lines
