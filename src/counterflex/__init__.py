"""Counterflex: plan, prove and correct the elastic deflection of milling robots.

``import counterflex as cf`` gives the ten names of :mod:`counterflex.api`; nothing heavy is loaded before one is used.
``__init__.pyi`` tells type checkers where they come from; here an import would point upward from every module.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

__all__ = (
    "choose_posture",
    "compare",
    "compensate",
    "deflection",
    "identify_cell",
    "inspect_part",
    "preflight",
    "prove",
    "read_cell",
    "simulate",
)


def __getattr__(name: str) -> Any:
    """One of the ten names, loaded when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("counterflex.api"), name)


def __dir__() -> list[str]:
    """Names that the package offers."""
    return sorted({*globals(), *__all__})
