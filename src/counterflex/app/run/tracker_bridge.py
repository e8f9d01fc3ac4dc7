"""A bridge from a tracker's own program to the loop: lines of text in, datagrams out, as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from counterflex.core.errors import FileFormatError
from counterflex.files.logs.tracker_log import TrackerLines
from counterflex.protocols.tracker.forwarder import PoseForwarder


def forward(
    lines: Iterable[str], peer: tuple[str, int], where: str, *, complain: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Send every line as a datagram at once; the first line names the columns.

    A line that cannot be used is left out: its number in the sequence is missing, so that the receiver counts a loss.

    Args:
        lines: As :mod:`counterflex.files.logs.tracker_log` describes them.
        peer: Where datagrams go.
        where: Of the lines, for messages.
        complain: Told of every line that is left out.

    Returns:
        Summary: datagrams sent, lines skipped.

    Raises:
        FileFormatError: There is no first line, or it names other columns.
        OutputError: The address cannot be used.
    """
    reader: TrackerLines | None = None
    sequence = skipped = 0
    sender = PoseForwarder(peer)
    try:
        for line in lines:
            if reader is None:
                reader = TrackerLines(line, where)
                continue
            try:
                measured = reader.measured(line, sequence + 1)
            except FileFormatError as fault:
                skipped += 1
                sequence += 1
                complain(str(fault))
                continue
            if measured is not None:
                sequence += 1
                sender.send(measured)
    finally:
        sender.close()
    if reader is None:
        raise FileFormatError("nothing came", where=where, limit="a line that names the columns")
    return {"job": "tracker bridge", "sent": sender.sent, "left_out": skipped}
