"""Data of a controller about its cell: tools, bases, loads, place of the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.registry import Registry
from counterflex.core.similar import close_to


@dataclass(frozen=True)
class Load:
    """Load data of a tool."""

    mass_kg: float  # > 0
    p_flange_com: tuple[float, float, float]  # (3,) m, centre of gravity in the flange


@dataclass
class ControllerData:
    """Frames by the names of the controller: numbers as text on KUKA, names on ABB."""

    kind: str = ""  # ``KUKA``, ``ABB`` or ``RoboDK``
    tools: dict[str, Float] = field(default_factory=dict)  # (4, 4) m, tool in the flange
    bases: dict[str, Float] = field(default_factory=dict)  # (4, 4) m, frame in the world
    loads: dict[str, Load] = field(default_factory=dict)
    titles: dict[str, str] = field(default_factory=dict)  # What people call a tool (``tool 1``) or base (``base 1``)
    T_world_base: Float = field(default_factory=lambda: np.eye(4))  # (4, 4) m, robot base in the world
    root_known: bool = False  # A file says where the base is in the world
    # Lower and upper software limit of axes by index, as the controller shows them
    limits_rad: dict[int, tuple[float, float]] = field(default_factory=dict)
    # Lengths of the arm that the machine data have, by the names of :class:`~counterflex.robot.model.description.Opw`
    lengths_m: dict[str, float] = field(default_factory=dict)
    model: str = ""
    notes: list[str] = field(default_factory=list)  # What the user should know, one sentence each

    def merge(self, other: ControllerData) -> None:
        """Take what another file of the same controller says.

        Raises:
            InputError: It is of another kind of controller, or both name the same frame differently.
        """
        if self.kind and other.kind != self.kind:
            raise InputError("the files are of different controllers", value=other.kind, limit=self.kind)
        self.kind = other.kind
        for what, mine, theirs in (("tool", self.tools, other.tools), ("base", self.bases, other.bases)):
            for name, T in theirs.items():
                if name in mine and not np.allclose(mine[name], T, rtol=0.0, atol=1e-9):
                    raise InputError(f"two files give the {what} {name} differently", value=name,
                                     hint="Give the files of one controller and one backup")  # fmt: skip
                mine[name] = T
        self.loads |= other.loads
        self.titles |= other.titles
        self.notes += other.notes
        self.limits_rad |= other.limits_rad
        self.lengths_m |= other.lengths_m
        self.model = other.model or self.model
        if other.root_known:
            if self.root_known and not np.allclose(self.T_world_base, other.T_world_base, rtol=0.0, atol=1e-9):
                raise InputError("two files say differently where the robot stands in its world",
                                 hint="Give the files of one controller and one backup")  # fmt: skip
            self.T_world_base, self.root_known = other.T_world_base, True

    def base_in_robot(self, name: str) -> Float:
        """(4, 4) m, a base in the robot's base frame."""
        out: Float = np.linalg.inv(self.T_world_base) @ self.named(name, "base")
        return out

    def named(self, name: str, what: str) -> Float:
        """(4, 4) m, a tool or base by name, capitals or not. Raises InputError: there is none."""
        frames = self.tools if what == "tool" else self.bases
        by_capitals = {key.upper(): key for key in frames}
        key = by_capitals.get(name.upper())
        if key is None:
            close = close_to(name, list(frames), 1)
            raise InputError(
                f"the controller has no {what} of this name", value=name,
                limit=", ".join(list(frames)[:12]) or "none is set",
                hint=f"Did you mean {close[0]}?" if close else f"Give the file that sets the {what}",
            )  # fmt: skip
        return frames[key]


@dataclass(frozen=True)
class DataKind:
    """Files of a controller."""

    title: str
    # Data of a text, by its text and name; None where it is none of these files
    read: Callable[[str, str], ControllerData | None]
    root: str = ""  # File that says where the robot stands in the world of the controller


DATA_KINDS: Final[Registry[DataKind]] = Registry(
    "counterflex.controller_data",
    "kind of controller data",
    "counterflex.app.controller_import.frames:DataKind",
)
