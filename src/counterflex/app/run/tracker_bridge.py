"""A bridge from a tracker's own program to the loop: lines of text in, datagrams out, as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from counterflex.core.errors import FileFormatError
from counterflex.files.logs.tracker_exports.formats import OWN, lines_of
from counterflex.protocols.system.forwarder import Forwarder


def forward(
    lines: Iterable[str],
    peer: tuple[str, int],
    where: str,
    *,
    form: str = OWN,
    complain: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Send every measurement as a datagram at once.

    A line that cannot be used is left out: its number in the sequence is missing, so that the receiver counts a loss.

    Args:
        peer: Where datagrams go.
        where: Of the lines, for messages.
        form: One of :data:`counterflex.files.logs.tracker_exports.formats.FORMATS`; ours is described in
            :mod:`counterflex.files.logs.tracker_log`.
        complain: Told of every line that is left out.

    Returns:
        Summary: datagrams sent, lines skipped.

    Raises:
        FileFormatError: Nothing came, or what stands before the measurements cannot be used (columns, unit).
        OutputError: The address cannot be used.
    """
    reader = lines_of(form, where)
    sequence = skipped = 0
    sender = Forwarder(peer, "poses")
    try:
        for line in lines:
            ready = reader.ready
            try:
                measured = reader.measured(line, sequence + 1)
            except FileFormatError as fault:
                if not ready:
                    raise
                skipped += 1
                sequence += 1
                complain(str(fault))
                continue
            if measured is not None:
                sequence += 1
                sender.send(measured.telegram())
    finally:
        sender.close()
    if not reader.ready:
        raise FileFormatError("nothing came", where=where, limit="a line that names the columns")
    return {"job": "tracker bridge", "sent": sender.sent, "left_out": skipped}
