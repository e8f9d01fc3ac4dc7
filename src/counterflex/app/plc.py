"""PLCs that show sensors and take parameters, by name: what commands ask of them, whatever they speak."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from counterflex.core.registry import Registry


@dataclass(frozen=True, kw_only=True)
class Plc:
    """A kind of PLC that a cell file can have a table of."""

    title: str  # One line for help
    # ``(cell file, text) -> list``: name, type and comment of its variables whose names contain a text
    symbols: Callable[..., list[Any]]
    read: Callable[..., dict[str, Any]]  # ``(cell file) -> dict``: all that the table names, once
    write: Callable[..., dict[str, Any]]  # ``(cell file, name, value) -> dict``: a parameter, and read back
    # ``(cell file, address, **limits) -> dict``: tracker or strains as datagrams
    forward: Callable[..., dict[str, Any]]
    alone: str  # ``module:object`` of ``(**settings) -> dict``, a simulated one by itself
    terminals: str  # ``module:object`` of ``(cell, amplifiers, address)``: a simulated one that shows strains


PLCS: Final[Registry[Plc]] = Registry("counterflex.plcs", "kind of PLC", "counterflex.app.plc:Plc")
