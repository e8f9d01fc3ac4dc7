"""A bad network between two programs, as a job of its own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from counterflex.core.atomic import open_record
from counterflex.core.errors import InputError
from counterflex.twin.network.impairment import Burst, Impairment, Schedule, Stall
from counterflex.twin.network.proxy import BACK, THERE, DecisionLog, UdpProxy, read_decisions

_WAYS = ("both", "there", "back")


@dataclass(frozen=True)
class ProxySettings:
    """What the proxy does.

    Attributes:
        listen: Address that the side which begins sends to.
        to: The other side.
        way: Which way is bad: ``both``, ``there`` or ``back``.
        loss: As all that follows: see :class:`counterflex.twin.network.impairment.Impairment`.
        burst_share: Share lost in bursts; 0: none.
        burst_mean: Their mean length, datagrams.
        pattern: See there.
        delay_s: See there.
        jitter_s: See there.
        duplicate: See there.
        reorder: See there.
        reorder_s: See there.
        flip: See there.
        truncate: See there.
        garbage: See there.
        stall: Or None.
        period_s: See there.
        first: See there.
        seed: Of chance.
        replay: Log whose decisions are made again, instead of all of the above; or None.
    """

    listen: tuple[str, int]
    to: tuple[str, int]
    way: str = "both"
    loss: float = 0.0
    burst_share: float = 0.0
    burst_mean: float = 3.0
    pattern: str = ""
    delay_s: float = 0.0
    jitter_s: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    reorder_s: float = 6e-3
    flip: float = 0.0
    truncate: float = 0.0
    garbage: float = 0.0
    stall: Stall | None = None
    period_s: float = 4e-3
    first: int = 0
    seed: int = 0
    replay: Path | None = None

    def impairment(self) -> Impairment:
        """Of the bad way.

        Raises:
            InputError: A number is out of range.
        """
        return Impairment(
            loss=self.loss,
            burst=Burst(self.burst_share, self.burst_mean) if self.burst_share else None,
            pattern=self.pattern,
            delay_s=self.delay_s,
            jitter_s=self.jitter_s,
            duplicate=self.duplicate,
            reorder=self.reorder,
            reorder_s=self.reorder_s,
            flip=self.flip,
            truncate=self.truncate,
            garbage=self.garbage,
            stalls=() if self.stall is None else (self.stall,),
            period_s=self.period_s,
            first=self.first,
        )


def stall_of(text: str) -> Stall | None:
    """Stall of ``FIRST:COUNT``; None of an empty text.

    Raises:
        InputError: It is none.
    """
    if not text:
        return None
    first, colon, count = text.partition(":")
    if not colon or not first.isdecimal() or not count.isdecimal():
        raise InputError("--stall is none", value=text, limit="FIRST:COUNT, for example 500:25")
    return Stall(int(first), int(count))


def run(
    settings: ProxySettings,
    *,
    log: Path | None = None,
    seconds: float | None = None,
    started: Callable[[tuple[str, int]], None] = lambda _: None,
    ended: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Carry datagrams until the time is over or it is interrupted.

    Args:
        settings: See :class:`ProxySettings`.
        log: Where to log what was done, or None.
        seconds: Or None: until interrupted.
        started: Told the address before the first datagram.
        ended: Asked now and then whether to stop.

    Returns:
        Datagrams carried and lost, each way.

    Raises:
        InputError: A setting is out of range.
        FileFormatError: The log to be done again is none.
        OutputError: An address or the log cannot be opened.
    """
    if settings.way not in _WAYS:
        raise InputError("no such way", value=settings.way, limit=", ".join(_WAYS))
    if settings.replay is not None:
        there, back = read_decisions(settings.replay)
        deciders: Any = (there, back)
    else:
        made = settings.impairment()
        deciders = tuple(
            Schedule(made if settings.way in ("both", name) else Impairment(), settings.seed, way)
            for way, name in ((THERE, "there"), (BACK, "back"))
        )
    with ExitStack() as stack:
        decisions = None if log is None else DecisionLog(stack.enter_context(open_record(log)))
        proxy = UdpProxy(settings.listen, settings.to, *deciders, log=decisions)
        stack.callback(proxy.close)
        started(proxy.address)
        try:
            proxy.run(seconds, ended=ended)
        except KeyboardInterrupt:
            if seconds is not None:
                raise
        return {
            name: {"carried": proxy.carried[way], "lost": proxy.lost[way]}
            for way, name in ((THERE, "there"), (BACK, "back"))
        }
