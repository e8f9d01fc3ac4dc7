"""A bad network between two programs, as a job of its own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from counterflex.core.atomic import open_record
from counterflex.twin.network.impairment import Impairment, Schedule
from counterflex.twin.network.proxy import BACK, THERE, DecisionLog, UdpProxy, read_decisions


@dataclass(frozen=True)
class ProxySettings:
    """Settings of the proxy."""

    listen: tuple[str, int]  # Address that the side which begins sends to
    to: tuple[str, int]  # The other side
    way: Literal["both", "there", "back"] = "both"  # Which way is bad: ``both``, ``there`` or ``back``
    impairment: Impairment = field(default_factory=Impairment)  # Of the bad way
    seed: int = 0  # Of chance
    replay: Path | None = None  # Log whose decisions are made again, instead of all of the above; or None

    def run(
        self,
        *,
        log: Path | None = None,
        seconds: float | None = None,
        started: Callable[[tuple[str, int]], None] = lambda _: None,
        ended: Callable[[], bool] = lambda: False,
    ) -> dict[str, Any]:
        """Carry datagrams until the time is over or it is interrupted.

        Args:
            log: Where to log what was done, or None.
            seconds: Or None: until interrupted.
            started: Told the address before the first datagram.
            ended: Asked now and then whether to stop.

        Returns:
            Datagrams carried and lost, each way.

        Raises:
            FileFormatError: The log to be done again is none.
            OutputError: An address or the log cannot be opened.
        """
        if self.replay is not None:
            there, back = read_decisions(self.replay)
            deciders: Any = (there, back)
        else:
            deciders = tuple(
                Schedule(self.impairment if self.way in ("both", name) else Impairment(), self.seed, way)
                for way, name in ((THERE, "there"), (BACK, "back"))
            )
        with ExitStack() as stack:
            decisions = None if log is None else DecisionLog(stack.enter_context(open_record(log)))
            proxy = UdpProxy(self.listen, self.to, *deciders, log=decisions)
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
