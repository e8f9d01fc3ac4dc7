"""Kinds of files of a controller that are read, by maker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from counterflex.app.controller_import.frames import ControllerData
from counterflex.core.registry import Registry


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
    "counterflex.app.controller_import.kinds:DataKind",
)
