"""Links to robots by name: what the loop runs on, and the simulated controller that answers it.

``[online] protocol`` of the cell file names one; another package adds one with an entry point of the group
``counterflex.robot_links`` (docs/extend.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.registry import Registry
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.online import OnlineTable
from counterflex.files.scenario_file import Scenario
from counterflex.plan.plan import Plan
from counterflex.protocols.force.sensors import Value, checked_values
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.runtime.settings import OnlineSettings
from counterflex.twin.devices.commanded_motion import RobotController

Address = tuple[str, int]
Chosen = tuple[str, Path | None]
"""Name of a link, and the file that it is set up by, or None."""


@dataclass(frozen=True, kw_only=True)
class LinkOrder:
    """Order to open a link.

    Attributes:
        file: That it is set up by, or None.
        online: Settings of the loop.
        host: Address to listen on.
        port: None takes the one of the file or of the cell.
        peer: The controller, port 0 for any; None takes the first that sends a good telegram.
        plan: Of the program, or None.
        compensated: The robot runs the compensated program.
        watch_only: The loop will not be armed.
        overriding: The loop changes the speed of the program, and uses the changed one.
        currents: The loop reads motor currents.
        values: Of ``[online.link]``, every key that the link has, with its default where the file has none.
    """

    cell: Cell
    file: Path | None = None
    online: OnlineSettings
    host: str = "127.0.0.1"
    port: int | None = None
    peer: Address | None = None
    plan: Plan | None = None
    compensated: bool = True
    watch_only: bool = True
    overriding: bool = False
    currents: bool = False
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ControllerOrder:
    """Order to make a simulated controller.

    Attributes:
        cell: What it has been told.
        file: As in :class:`LinkOrder`.
        scenario: Its table for this controller, if it has one.
        job: Number that its program says; 0: none.
        values: As in :class:`LinkOrder`.
    """

    cell: Cell
    file: Path | None = None
    scenario: Scenario = field(default_factory=Scenario)
    seed: int = 0
    job: int = 0
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SimulatedController:
    """A controller of the simulated cell.

    Attributes:
        controller: Its side of the protocol.
        peer: Where its telegrams go unless the scenario says otherwise.
        take_force: Told (6,) N, N m that the robot measures itself, or None where it cannot.
    """

    controller: RobotController
    peer: Address
    take_force: Callable[[Float], None] | None = None


@dataclass(frozen=True, kw_only=True)
class RobotLinkKind:
    """A protocol between robot and loop.

    Attributes:
        title: One line for help.
        how: How it is chosen, for messages: ``--rsi FILE for a KUKA robot``; empty: by the cell file only.
        open: Opens the link. Raises InputError where it cannot do what the loop wants.
        read: Reads the file that it is set up by, or raises FileFormatError; None: it has no file.
        own_force: ``(link, range_n, range_nm)``: the force that the robot itself measures; None: it sends none.
        values: Keys of ``[online.link]`` with their defaults; a value must be of the type of its default.
        simulated: ``module:object`` of what makes a :class:`SimulatedController` of a :class:`ControllerOrder`.
        alone: ``module:object`` of ``(watched, **settings) -> dict``, the simulated controller by itself, or empty.
    """

    title: str
    how: str = ""
    open: Callable[[LinkOrder], RobotLink]
    read: Callable[[Path], Any] | None = None
    own_force: Callable[[Any, float | None, float | None], ForceSource] | None = None
    values: Mapping[str, Value] = field(default_factory=dict)
    simulated: str = ""
    alone: str = ""


ROBOT_LINKS: Final[Registry[RobotLinkKind]] = Registry(
    "counterflex.robot_links", "link to a robot", "counterflex.app.run.robot_links:RobotLinkKind"
)


def chosen(given: Chosen | None, cell: Cell) -> Chosen:
    """The link of a run: the one that is given, else the one that the cell file names.

    Raises:
        InputError: There is none, or they are two; or it needs a file, or has none.
    """
    named = (cell.tables.online or OnlineTable()).protocol
    name, file = given if given is not None else (named, None)
    if name is None or named not in (None, name):
        raise InputError(
            "the robot's protocol is not clear",
            where=str(cell.path),
            value="none" if name is None else f'{name}, and [online] protocol = "{named}"',
            limit=" or ".join(kind.how for _, kind in ROBOT_LINKS.items() if kind.how),
            hint=f"Give one of them, or name it in [online] protocol: {', '.join(ROBOT_LINKS)}",
        )
    if (ROBOT_LINKS[name].read is None) != (file is None):
        raise InputError(
            f"the link {name} {'needs a' if file is None else 'has no'} file", where=str(cell.path), value=file,
            hint=ROBOT_LINKS[name].how or None,
        )  # fmt: skip
    return name, file


def values_of(name: str, cell: Cell) -> dict[str, Value]:
    """Values of ``[online.link]`` with defaults.

    Raises:
        FileFormatError: A key that the link does not have, or a value of another type than its default.
    """
    try:
        return checked_values(name, ROBOT_LINKS[name].values, (cell.tables.online or OnlineTable()).link)
    except ValueError as fault:
        raise FileFormatError(str(fault), where=f"{cell.path}: online.link") from fault
