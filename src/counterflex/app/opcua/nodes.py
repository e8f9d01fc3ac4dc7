"""Nodes of the OPC UA server: where each value stands, its unit, and where it comes from. Pure: no server, no clock.

Names and places of the robot are those of OPC 40010-1 (OPC UA for Robotics, part 1) where counterflex knows the thing:
axes, speed override, on path, name of the task's program. What it does not know is left out: the operational mode, the
emergency and protective stops, loads, power of the drives.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from asyncua import ua

from counterflex.app.panel.watched_run import Seen
from counterflex.core.errors import CounterflexError
from counterflex.core.printable import all_printable
from counterflex.core.units import DEG
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.runtime.monitoring.events import Event

SYSTEM: Final = "MotionDeviceSystem"
ROBOT: Final = f"{SYSTEM}/MotionDevices/Robot"
OWN: Final = "Counterflex"
ALARMS: Final = f"{OWN}/Alarms"
ROTARY: Final = 1
"""AxisMotionProfileEnumeration of OPC 40010-1."""
ARTICULATED: Final = 1
"""MotionDeviceCategoryEnumeration of OPC 40010-1: articulated robot."""
UNITS: Final = {
    "um": ("4H", "µm", "micrometre"),
    "mm": ("MMT", "mm", "millimetre"),
    "N": ("NEW", "N", "newton"),
    "deg": ("DD", "°", "degree [unit of angle]"),
    "mdeg": ("", "m°", "thousandth of a degree"),
    "%": ("P1", "%", "percent"),
    "us": ("B98", "µs", "microsecond"),
    "ms": ("C26", "ms", "millisecond"),
    "Hz": ("HTZ", "Hz", "hertz"),
}
"""Common code of UNECE recommendation 20, sign, name."""


@dataclass(frozen=True)
class View:
    """Source of a value."""

    seen: Seen
    about: Mapping[str, Any]
    figures: Mapping[str, Any]  # See :class:`counterflex.app.panel.figures.Figures`; empty: nothing is known yet
    last: Any  # Last snapshot, or None
    why: str  # Why a run that goes on cannot be read

    def program_name(self) -> str | None:
        """Name of the program that runs."""
        files = self.about.get("files", {})
        name = files.get("program", files.get("plan"))
        return None if name is None else Path(name).name

    def on_path(self) -> bool | None:
        """True where the tool is on the path of the plan; None before the first answer."""
        return None if self.last is None else bool(self.last.share >= 0.0)


@dataclass(frozen=True)
class Node:
    """A variable."""

    path: str  # Names from the Objects folder on, with slashes
    # Of its kind, shown while nothing is known: text, number, whole number or truth value
    default: str | float | int | bool
    unit: str  # Of :data:`UNITS`, or empty
    of: Callable[[View], Any]  # Its value; None: not known, or there is no such source
    live: bool = True  # It comes from the loop: without one it is bad

    def value(self, view: View) -> tuple[Any, int]:
        """Value of a node, of the kind of its default, and the status code that goes with it.

        Bad_NoCommunication: no run, or nothing of it yet. Bad_NotConnected: the run has no such source. Uncertain: the
        last value of a loop that is silent or has ended.
        """
        if self.live and (view.seen == Seen.WAITING or not view.figures):
            return self.default, ua.StatusCodes.BadNoCommunication
        value = self.of(view)
        if value is None:
            return self.default, ua.StatusCodes.BadNotConnected
        stale = self.live and view.seen != Seen.RUNNING
        return type(self.default)(
            all_printable(value)
        ), ua.StatusCodes.UncertainLastUsableValue if stale else ua.StatusCodes.Good


def _figure(*keys: str | int) -> Callable[[View], Any]:
    def of(view: View) -> Any:
        value: Any = view.figures
        for key in keys:
            if value is None or (isinstance(key, str) and key not in value):
                return None
            value = value[key]
        return value

    return of


def _axis(k: int) -> Callable[[View], float | None]:
    def of(view: View) -> float | None:
        if view.last is None:
            return None
        axes = _axes_of(view.about.get("files", {}).get("cell", ""))
        return None if axes is None else float(axes.shown(view.last.q)[k]) / DEG

    return of


@functools.lru_cache(maxsize=8)
def _axes_of(cell: str) -> ControllerAxes | None:
    """Return the axis convention of a run's cell; None where its file is gone or cannot be read."""
    from counterflex.files.cell.cell import read_cell  # heavy, and not needed before a run

    if not cell:
        return AS_MODEL
    try:
        return read_cell(cell).robot.axes
    except CounterflexError:
        return None


def _event(event: Event, key: str) -> Callable[[View], Any]:
    def of(view: View) -> Any:
        events = view.figures.get("events")
        return None if not events else events[event][key]

    return of


def _incident(key: str, missing: Any) -> Callable[[View], Any]:
    """Of the incident that is latched; without one, what stands for none."""

    def of(view: View) -> Any:
        if not view.figures:
            return None
        incident = view.figures["incident"]
        return missing if incident is None else incident[key]

    return of


def _robot() -> list[Node]:
    task = f"{SYSTEM}/Controllers/Controller/TaskControls/Task/ParameterSet"
    nodes = [
        Node(f"{ROBOT}/MotionDeviceCategory", 0, "", lambda _: ARTICULATED, live=False),
        Node(f"{ROBOT}/ParameterSet/OnPath", False, "", View.on_path),
        Node(f"{ROBOT}/ParameterSet/SpeedOverride", 0.0, "%", _figure("speed")),
        Node(f"{task}/TaskProgramName", "", "", View.program_name),
        Node(f"{task}/TaskProgramLoaded", False, "", lambda view: bool(view.figures)),
    ]
    for k in range(6):
        axis = f"{ROBOT}/Axes/Axis_{k + 1}"
        nodes.append(Node(f"{axis}/MotionProfile", 0, "", lambda _: ROTARY, live=False))
        nodes.append(Node(f"{axis}/ParameterSet/ActualPosition", 0.0, "deg", _axis(k)))
    return nodes


def _of_run() -> list[Node]:
    run, state, part = f"{OWN}/Run", f"{OWN}/State", f"{OWN}/Correction"
    path, link = f"{OWN}/Path", f"{OWN}/Link"
    tally = {"TelegramsLost": "lost", "TelegramsLate": "late", "TelegramsUnreadable": "malformed"}
    tally |= {"TelegramsOfUnknownSenders": "foreign"}
    return [
        Node(f"{run}/Connection", "", "", lambda view: view.seen.value, live=False),
        Node(f"{run}/Trouble", "", "", lambda view: view.why, live=False),
        Node(f"{run}/Version", "", "", lambda view: view.about.get("counterflex")),
        Node(f"{run}/Folder", "", "", lambda view: view.about.get("folder")),
        Node(f"{run}/Protocol", "", "", lambda view: view.about.get("protocol")),
        Node(f"{run}/MayArm", False, "", _figure("may_arm")),
        Node(f"{state}/State", "", "", _figure("state")),
        Node(f"{state}/Cause", "", "", _figure("cause")),
        Node(f"{state}/NotReady", "", "", _figure("not_ready")),
        Node(f"{state}/FeedHold", False, "", _figure("feed_hold")),
        Node(f"{state}/StopRequested", False, "", _figure("stop")),
        Node(f"{part}/Size", 0.0, "um", _figure("correction_um")),
        Node(f"{part}/SizeLimit", 0.0, "um", _figure("limit_um")),
        Node(f"{part}/Rotation", 0.0, "mdeg", _figure("turn_mdeg")),
        Node(f"{part}/RotationLimit", 0.0, "mdeg", _figure("turn_limit_mdeg")),
        Node(f"{part}/Limited", False, "", _figure("limited")),
        Node(f"{path}/Share", 0.0, "%", _figure("share")),
        Node(f"{path}/Tool", 0, "", _figure("tool")),
        Node(f"{path}/SlowedBy", "", "", _figure("slowed")),
        Node(f"{link}/Rate", 0.0, "Hz", _figure("rate_hz")),
        Node(f"{link}/AnswerMedian", 0.0, "us", _figure("answer_us", 0)),
        Node(f"{link}/AnswerLargest", 0.0, "us", _figure("answer_us", 1)),
        Node(f"{link}/LogTrouble", "", "", _figure("log")),
        Node(f"{link}/RecordsLost", 0, "", _figure("records_lost")),
        *(Node(f"{link}/{name}", 0, "", _figure("tally", key)) for name, key in tally.items()),
        *(Node(f"{link}/{n.title()}Age", 0.0, "ms", _figure("ages_ms", n)) for n in ("robot", "force", "tracker")),
    ]


def _measured() -> list[Node]:
    out = [
        Node(f"{OWN}/Deviation/{kind.title()}{side}", 0.0, "um", _figure(f"{kind}_um", k))
        for kind in ("predicted", "corrected", "remaining", "measured")
        for k, side in enumerate(("Across", "AlongTool"))
    ]
    for kind, key in (("Measured", "force"), ("Planned", "planned")):
        out.append(Node(f"{OWN}/Force/{kind}Size", 0.0, "N", _figure(f"{key}_size_n")))
        out += [
            Node(f"{OWN}/Force/{kind}{side}", 0.0, "N", _figure(f"{key}_n", k))
            for k, side in enumerate(("AlongFeed", "Across", "AlongTool"))
        ]
    return out


def _alarms() -> list[Node]:
    first = f"{ALARMS}/Incident"
    out = [
        Node(f"{first}/Active", False, "", lambda v: None if not v.figures else v.figures["incident"] is not None),
        Node(f"{first}/Cause", "", "", _incident("cause", "")),
        Node(f"{first}/State", "", "", _incident("state", "")),
        Node(f"{first}/Over", False, "", _incident("over", True)),
        Node(f"{first}/Count", 0, "", _figure("incidents")),
    ]
    for event in Event:
        name = event.name.title().replace("_", "")
        out.append(Node(f"{ALARMS}/{name}/Active", False, "", _event(event, "on")))
        out.append(Node(f"{ALARMS}/{name}/Watched", False, "", _event(event, "watched")))
        out.append(Node(f"{ALARMS}/{name}/ShareOfLimit", 0.0, "", _event(event, "share")))
    return out


NODES: Final = (*_robot(), *_of_run(), *_measured(), *_alarms())
"""All variables."""


def occurred(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[tuple[str, int]]:
    """Events between two looks: message and severity (1 to 1000, OPC UA part 5).

    Args:
        before: Figures of the look before, or empty.
    """
    out = []
    if now and now["incidents"] > before.get("incidents", 0) and now["incident"] is not None:
        one = now["incident"]
        out.append((f"{one['state']}: {one['cause']}", 900 if one["state"] == "FAULT" else 700))
    if before.get("incident") is not None and now and now["incident"] is None:
        out.append(("incident acknowledged", 100))
    on = {one["event"] for one in before.get("events", ()) if one["on"]}
    out += [(f"process: {one['event']}", 500) for one in now.get("events", ()) if one["on"] and one["event"] not in on]
    return out
