"""What a run says of itself once, beside its snapshots: files, limits, cycle; for the panel and any other reader."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app.run.session import RunSettings, robot_files
from counterflex.protocols.session.session import OnlineSession


def about_run(settings: RunSettings, session: OnlineSession, out: Path) -> dict[str, Any]:
    """What a run is.

    Args:
        settings: What it is made of.
        session: Opened.
        out: Folder of its log.

    Returns:
        Plain values, SI: ``files`` by name (absolute), ``folder``, ``period_s``, ``limits`` of the correction,
        ``listens`` (address of telegrams), ``sources`` it measures with, ``planned``, ``compensated``, ``arm``, and the
        difference of wall clock and monotonic clock in ns.
    """
    loop = session.loop.settings
    files = {"cell": settings.cell, "plan": settings.plan, "program": settings.program, **robot_files(settings)}
    radius, turn = loop.translation.radius, loop.rotation.radius
    return {
        "counterflex": __version__,
        "folder": str(out),
        "files": {name: str(Path(path).absolute()) for name, path in files.items() if path is not None},
        "period_s": loop.period_s,
        "limits": {
            "correction_m": radius,
            "correction_rad": turn,
            "hard_factor": loop.hard_factor,
            "ramp_m_s": loop.ramp_m_s,
            "speed_m_s": loop.translation.speed,
        },
        "listens": list(session.link.address),
        "protocol": (settings.robot or ("",))[0].upper(),
        "holds_feed": bool(session.link.holds_feed),
        "sources": {"force": session.force is not None, "tracker": session.tracker is not None},
        "force_mode": loop.force.name.lower(),
        "planned": session.loop.planned,
        "compensated": loop.compensated,
        "arm": settings.arm,
        "lockstep": settings.lockstep,
        "wall_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
    }
