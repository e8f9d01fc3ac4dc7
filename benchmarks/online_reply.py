"""Benchmark of the online loop: one step, and the whole reply to a telegram beside a do-nothing echo in the same run.

``python benchmarks/online_reply.py [--quick] [--seconds S] [--stages] [--spin-us US] [--json FILE]``. The step: compute
time of one call in each mode, in blocks that alternate with an empty call.

The reply: the real session (telegrams every 4 ms, force and tracker at 1 kHz, records into the ring) answers a cell in
another process, which times from sending a telegram to having its answer; half a cycle later the same telegram goes to
a third process that only sends it back: compiled, two system calls, the first one blocks, as a program in C. All three
are prepared as the loop is: real-time priority, locked memory, no garbage collection, as far as the system allows.

A machine that stands still for some cycles makes the loop hold or stop the robot. The robot program obeys a feed hold
and is started again when it was stopped, and this program is the operator, who acknowledges and arms again; all of it
is counted. Percentiles are printed over every telegram, over those while the correction acts (where the goals are), and
over those of them outside of standstills, which the played cell's own clock and the echo tell.

``--stages`` also times the parts of the reply, made in steps instead of in one call. Every clock that is read costs
time itself, most of it where caches are cold, so such a run says what the parts are to each other, and not how long
the reply takes.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import signal
import socket
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from counterflex.app.doctor import feed
from counterflex.app.environment import environment
from counterflex.app.run import session as online_session
from counterflex.core.arrays import Int
from counterflex.core.jit import kernel
from counterflex.files.cell.cell import read_cell
from counterflex.integrations.ati.simulated import NetftServer
from counterflex.integrations.kuka.link.config import read_config
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.protocols.decimal_kernel import Bytes
from counterflex.protocols.processes.control_array import Request
from counterflex.protocols.session.session import OnlineSession
from counterflex.protocols.system import timing_probe
from counterflex.protocols.system.machine import processor_times
from counterflex.protocols.system.realtime import prepare
from counterflex.protocols.system.system_calls import NAME, THERE, send_to
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.live.live_cell import Report
from counterflex_lab.soak import replayed_cell as steady
from counterflex_lab.soak.operator import requested_words
from counterflex_lab.soak.recorded_cell import GATE, ReplayedCell
from counterflex_lab.soak.recorded_pass import RecordedPass
from counterflex_lab.soak.replay_figures import active, in_standstill, micro
from counterflex_lab.soak.timed_block import Block

LOOKED_CYCLES = 125
"""How often the operator looks."""
GOAL_STEP_US, GOAL_REPLY_P50_US, GOAL_REPLY_P999_US = 10.0, 80.0, 500.0
MODES: dict[str, tuple[ForceMode, TrackerMode]] = {
    "measured": (ForceMode.MEASURED, TrackerMode.NONE),
    "pilot": (ForceMode.PILOT, TrackerMode.NONE),
    "scale": (ForceMode.SCALE, TrackerMode.NONE),
    "tracker observer": (ForceMode.NONE, TrackerMode.OBSERVER),
    "scale and observer": (ForceMode.SCALE, TrackerMode.OBSERVER),
    "fused": (ForceMode.FUSED, TrackerMode.NONE),
}


def _loop(force: ForceMode, tracker: TrackerMode) -> Loop:
    with resources.as_file(resources.files("counterflex.app") / "demo" / "cell.toml") as file:
        cell = read_cell(file)
    x = np.linspace(0.0, 0.2, 500)
    w = np.zeros((500, 6))
    w[:, :3] = 40.0, 250.0, -60.0
    plan = LoopPlan(np.stack([x, 0.0 * x, 0.0 * x], axis=1), x / 0.025, w, np.ones(500), np.zeros((500, 6)))
    return Loop(cell.chain, OnlineSettings(force=force, tracker=tracker), cell.T_base_part, plan)


def steps(blocks: int, calls: int) -> dict[str, dict[str, float]]:
    """Percentiles of one step in us, per mode, in alternating blocks."""
    loops = {name: _loop(*modes) for name, modes in MODES.items()}
    candidates: dict[str, Callable[[], object]] = {"empty call": lambda: None}
    for name, loop in loops.items():
        for k in range(50):
            feed(loop, k)
        candidates[name] = loop.run
    clock = time.perf_counter_ns
    times: dict[str, list[int]] = {name: [] for name in candidates}
    for _ in range(blocks):
        for name, call in candidates.items():
            for _ in range(calls):
                start = clock()
                call()
                times[name].append(clock() - start)
    return {name: micro(1e-9 * np.array(t, dtype=np.float64)) for name, t in times.items()}


if THERE:
    _recvfrom: Any = types.ExternalFunction(
        "recvfrom", types.intp(types.int32, types.intp, types.uintp, types.int32, types.intp, types.intp)
    )

    @kernel("void(int64, uint8[::1], uint8[::1], int64[::1])", waits=True)
    def _echo(fd: int, data: Bytes, name: Bytes, size: Int) -> None:
        """Send every datagram back, as a program in C does: two system calls, the first one blocks."""
        while True:
            size[0] = NAME
            length = _recvfrom(fd, data.ctypes.data, data.shape[0], 0, name.ctypes.data, size.ctypes.data)
            if length > 0:
                send_to(fd, data, length, name)


def _echo_process(own: socket.socket) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    prepare()
    if THERE:
        own.setblocking(True)
        _echo(own.fileno(), np.zeros(2048, dtype=np.uint8), np.zeros(NAME, dtype=np.uint8), np.zeros(1, dtype=np.int64))
    else:
        timing_probe.echo(own)


def _cell_process(rsi: Path, played: RecordedPass, cycles: int, pipe: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    netft = NetftServer()
    cell = ReplayedCell(played, FakeRsi(read_config(rsi), RsiContext(timeout=1 << 30)), netft)
    pipe.send((netft.address, netft.http_address))
    while not pipe.poll(0.02):
        netft.poll()
    peer, tracker, echo = pipe.recv()
    prepare()
    blocks: list[Block] = []
    cell.run(peer, cycles, tracker=tracker, echo=echo, block=cycles, on_block=blocks.append)
    pipe.send(blocks[0])
    cell.close()


def _timed(session: OnlineSession) -> dict[str, list[int]]:
    """Lists that the times of a session's parts go to, ns; nested parts are indented."""
    clock = time.perf_counter_ns
    times: dict[str, list[int]] = {}

    def watch(owner: Any, name: str, part: str) -> None:
        inner, into = getattr(owner, name), times.setdefault(part, [])

        def timed(*args: Any, **chosen: Any) -> Any:
            start = clock()
            result = inner(*args, **chosen)
            into.append(clock() - start)
            return result

        setattr(owner, name, timed)

    session._whole = None  # the one call of a cycle shows no parts
    watch(session.link, "_read", "telegram read")
    watch(session, "handle_cycle", "all behind it")
    watch(session, "_take_telegram", "  telegram judged")
    watch(session.link, "fill", "    pose and axes")
    watch(session._senses, "read_force", "  force")
    watch(session.force, "drain", "    records taken in")
    watch(session._senses, "read_tracker", "  tracker")
    watch(session.tracker, "drain", "    poses taken in")
    watch(session, "_decide", "  step, and causes")
    watch(session.link, "answer", "  answer written and sent")
    watch(session._record, "write", "  record, behind the answer")
    return times


class _Operator:
    """Operator who acknowledges and arms again by the requests of ``counterflex operator``; counts what he did."""

    def __init__(self, session: OnlineSession) -> None:
        self._session, self._last = session, State.IDLE
        self.states: Counter[str] = Counter()
        self.incidents: Counter[str] = Counter()
        self.requests: Counter[str] = Counter()

    def see(self) -> None:
        """Once a cycle, behind the answer."""
        session = self._session
        state, result = session.loop.state, session.loop.result
        self.states[state.name.lower()] += 1
        if state != self._last and state in (State.HOLD, State.FAULT):
            self.incidents[f"{state.name.lower()} {Cause(result.cause).name.lower()}"] += 1
        self._last = state
        if session.loop.cycle % LOOKED_CYCLES == 0:
            action = requested_words(state.name.lower(), feed_hold=bool(result.feed_hold))
            if action:
                session.control[Request[action.upper()]] = 1
                self.requests[action] += 1


def reply(seconds: float, spin_us: float | None, stages: bool = False) -> dict[str, Any]:
    """Times of the reply and of the echo, of the loop's own part, and the machine's condition."""
    cycles = GATE + round(seconds / 4e-3)
    context = multiprocessing.get_context("spawn")
    own = timing_probe.echo_socket()
    here, there = context.Pipe()
    with tempfile.TemporaryDirectory() as folder:
        job = steady.prepare(Path(folder), cycles)
        _lengthen(job.rsi)
        if spin_us is not None:
            job.cell.write_text(f"{job.cell.read_text()}spin_us = {spin_us:g}\n")
        cell = context.Process(target=_cell_process, args=(job.rsi, job.played, cycles, there), daemon=True)
        echo = context.Process(target=_echo_process, args=(own,), daemon=True)
        ring = RecordRing()
        try:
            cell.start()
            force, http = here.recv()
            session = online_session.open_session(
                online_session.RunSettings(
                    job.cell,
                    ("rsi", job.rsi),
                    job.plan,
                    compensated=False,
                    port=0,
                    force=force,
                    force_http_port=http[1],
                    tracker_port=0,
                ),
                ring=ring,
            )
            size = _telegram_bytes(job)
            parts = _timed(session) if stages else {}
            session.control[Request.ARM] = 1
            session.loop.run()
            session.loop.reset()
            echo.start()
            timing_probe.await_echo(own.getsockname())
            tracker = None if session.tracker is None else session.tracker.address
            here.send((session.link.address, tracker, own.getsockname()))
            granted = prepare()
            compute = np.full(2 * cycles, np.nan)
            operator = _Operator(session)
            done = 0
            before = processor_times()
            while done < len(compute) and not here.poll(0.0):
                if session.cycle(session.patience_s if session.cycles else 0.1) and session.loop.cycle > 0:
                    compute[done] = session.compute_ns * 1e-9
                    done += 1
                operator.see()
            after = processor_times()
            block: Block = here.recv()
        finally:
            for process in (cell, echo):
                if process.pid is not None:
                    process.terminate()
                    process.join()
            ring.close()
            own.close()
    of_time = slice(GATE, None)
    acting, stood = active(block)[of_time], in_standstill(block)[of_time]
    answer_s, echo_s = block.reply_s[of_time], block.echo_s[of_time]
    reply_us, echo_us = micro(answer_s[acting]), micro(echo_s)
    late = np.isnan(answer_s)
    return {
        "reply_all_us": micro(answer_s),
        "reply_us": reply_us,
        "reply_outside_us": micro(answer_s[acting & ~stood]),
        "echo_us": echo_us,
        "echo_outside_us": micro(echo_s[~stood]),
        "ratio_p50": _ratio(reply_us["p50"], echo_us["p50"]),
        "ratio_p999": _ratio(reply_us["p999"], echo_us["p999"]),
        "loop_us": micro(compute[GATE:done]),
        "stages_us": {part: micro(1e-9 * np.array(t[GATE:], dtype=np.float64)) for part, t in parts.items()},
        "cycles": {
            "telegrams": len(answer_s),
            "active": int(np.sum(acting)),
            "without_session": block.paused,
            "feed_held": block.held_cycles,
            "in_standstills": int(np.sum(stood)),
            "missed_in_standstills": block.missed,
        },
        "longest_standstill_ms": round(float(np.max(block.woken_s)) * 1e3, 1),
        "unanswered": {
            "all": int(np.sum(late)),
            "active": int(np.sum(late & acting)),
            "active_outside_standstills": int(np.sum(late & acting & ~stood)),
        },
        "states": dict(operator.states),
        "incidents": dict(operator.incidents),
        "requests": dict(operator.requests),
        "programs_ended": dict(Counter(why for _, why in block.ended)),
        "telegram_bytes": size,
        "fifo": granted.fifo,
        "locked": granted.locked,
        "load": os.getloadavg()[0],
        "stolen": round((after[1] - before[1]) / max(1, after[0] - before[0]), 4),
    }


def _ratio(reply_us: float, echo_us: float) -> float | None:
    """None where either has no value, or so many never came that it is none."""
    return round(reply_us / echo_us, 2) if math.isfinite(reply_us) and math.isfinite(echo_us) else None


def _lengthen(rsi: Path) -> None:
    """Let the controller send motor currents and external axes too: a telegram of 600 bytes."""
    more = "".join(f'<ELEMENT TAG="DEF_{tag}" TYPE="DOUBLE" INDX="INTERNAL"/>' for tag in ("MACur", "EIPos"))
    text = rsi.read_text(encoding="utf-8")
    rsi.write_text(text.replace("</ELEMENTS>", f"{more}</ELEMENTS>", 1), encoding="utf-8")


def _telegram_bytes(job: steady.SteadyJob) -> int:
    played = job.played
    T, q = played.T_part_nominal[0], played.q_command[0]
    report = Report(0.0, T, T, q, q, True, False)
    return len(FakeRsi(read_config(job.rsi), RsiContext()).telegram(report))


def run(seconds: float, quick: bool, spin_us: float | None = None, stages: bool = False) -> dict[str, Any]:
    """Measure everything; ``quick`` only shows that it runs, ``stages`` times the parts of the reply too."""
    return {
        "schema": "counterflex-benchmark-online-reply",
        "version": 4,
        "quick": quick,
        "seconds": seconds,
        "machine": environment(),
        "step_us": steps(4 if quick else 200, 50 if quick else 200),
        "spin_us": spin_us,
        **reply(seconds, spin_us, stages),
    }


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    names = ("p50", "p99", "p999", "max")
    print(f"{'us':<34}" + "".join(f"{name:>10}" for name in ("p50", "p99", "p99.9", "max")) + f"{'n':>9}   goal")
    reply_row = "reply, while the correction acts"
    goals = {reply_row: f"p50 < {GOAL_REPLY_P50_US:g}, p99.9 < {GOAL_REPLY_P999_US:g}"}
    rows = {f"step, {name}": times for name, times in result["step_us"].items()}
    rows |= {
        "reply, every telegram": result["reply_all_us"],
        reply_row: result["reply_us"],
        "  the same outside of standstills": result["reply_outside_us"],
        "do-nothing echo": result["echo_us"],
        "  the same outside of standstills ": result["echo_outside_us"],
        "loop's own part": result["loop_us"],
    }
    rows |= result["stages_us"]
    for name, times in rows.items():
        goal = goals.get(name, f"p50 < {GOAL_STEP_US:g}" if name.startswith("step") and "empty" not in name else "")
        print(f"{name:<34}" + "".join(f"{times[key]:10.1f}" for key in names) + f"{times['n']:9d}   {goal}")
    print(
        f"reply over echo: p50 {_shown(result['ratio_p50'])}, p99.9 {_shown(result['ratio_p999'])}; telegram of "
        f"{result['telegram_bytes']} bytes; cycles: {_counted(result['cycles'])}"
    )
    print(f"not answered within the cycle: {_counted(result['unanswered'])}")
    print(f"states: {_counted(result['states'])}; holds and faults: {_counted(result['incidents'])}")
    print(f"operator: {_counted(result['requests'])}; robot program ended: {_counted(result['programs_ended'])}")
    print(
        f"real-time priority {result['fifo']}, memory locked {result['locked']}, load {result['load']:.1f}, "
        f"stolen {result['stolen']:.2%}, longest standstill {result['longest_standstill_ms']:g} ms"
    )


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items()) or "none"


def main() -> None:
    """Parse the command line, measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description="Benchmark of the online loop's reply")
    parser.add_argument("--quick", action="store_true", help="a smoke run of a few seconds")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long the reply is timed")
    parser.add_argument("--spin-us", type=float, help="[online] spin_us instead of its default")
    parser.add_argument("--stages", action="store_true", help="time the parts of the reply too")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    result = run(1.0 if arguments.quick else arguments.seconds, arguments.quick, arguments.spin_us, arguments.stages)
    show(result)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
