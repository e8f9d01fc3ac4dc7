"""Requests of the operator to a run that goes on, done without the command parser: a stop may not wait for it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

_ACTIONS: Final = ("status", "stop", "reset", "arm")


def quick(words: Sequence[str]) -> int | None:
    """Do a request of the operator at once, past the command parser, which takes longer to load than a stop may take.

    Args:
        words: Of the command line.

    Returns:
        Exit status; None where this is no plain request, so that the parser has to look at it.
    """
    plain = [word for word in words[2:] if word != "--json"]
    if words[:1] != ["operator"] or len(words) < 2 or words[1] not in _ACTIONS or len(plain) != 1:
        return None
    if plain[0].startswith("-") or len(words) - 2 - len(plain) > 1:
        return None
    return asked(Path(plain[0]), words[1], as_json="--json" in words[2:])


def asked(log: Path, action: str, *, as_json: bool) -> int:
    """Ask something of a run and print the answer.

    Args:
        log: Folder of the run.
        action: ``status``, ``stop``, ``reset`` or ``arm``.
        as_json: Print JSON.

    Returns:
        Exit status: 1 where it was refused.

    Raises:
        CounterflexError: No run goes on there, or it does not answer.
    """
    from counterflex.app.run.operator_requests import request

    found = request(log, action)
    if as_json:
        import json

        print(json.dumps(found, indent=2, allow_nan=False))
    else:
        cause = "" if found["cause"] == "none" else f" ({found['cause'].replace('_', ' ')})"
        held = ", feed held" if found["feed_hold"] else ""
        robot = "" if found["robot_heard"] else ", no telegram yet"
        print(f"{found['state'].replace('_', ' ')}{cause}, correction {found['correction_mm']:.3f} mm{held}{robot}")
        if action == "status":
            for line in _seen(found):
                print(line)
        if not found["done"]:
            print(f"{action} refused: {found['refused']}", file=sys.stderr)
    return int(not found["done"])


def _seen(found: dict[str, Any]) -> list[str]:
    """What else is to be seen of a run: place, force, how old each source is, strangers, losses."""
    lines = []
    if found["place"] is not None:
        lines.append(f"place: {100.0 * found['place']:.1f} % of the plan")
    force = [
        f"{found[key]:.0f} N {word}"
        for key, word in (("force_n", "measured"), ("planned_n", "planned"))
        if found[key] is not None
    ]
    if force:
        lines.append("force: " + ", ".join(force))
    ages = [f"{name} {'nothing yet' if age is None else f'{age:.0f} ms'}" for name, age in found["age_ms"].items()]
    lines.append("age: " + ", ".join(ages))
    if found.get("tracker_off") is not None:
        from counterflex.protocols.session.tracker_off import offset_message

        lines.append(offset_message(found["tracker_off"]))
    lines.append(f"foreign telegrams dropped: {found['foreign']}")
    lost = f" ({found['log_trouble']})" if found["log_trouble"] else ""
    lines.append(
        f"{'LOGGING STOPPED, ' if lost or found['records_lost'] else ''}records lost: {found['records_lost']}{lost}"
    )
    return lines
