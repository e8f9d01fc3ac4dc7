"""Announce that kernels are compiled: once for a computer and a version, and it takes minutes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Final

_KERNELS: Final = "counterflex.core.compiled"  # Module that the first call of a kernel imports, and nothing else does


class _BeforeKernels:
    """Finder that has Numba report compilations from the first call of a kernel on."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._notify = notify

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname == _KERNELS:
            self._listen()  # and stays: one that takes itself off the list has the next one left out
        return None

    def _listen(self) -> None:
        from numba.core import event

        reported = {"on_start": lambda *_: self._notify(), "on_end": lambda *_: None}
        event.register("numba:compile", type("CompileListener", (event.Listener,), reported)())


def tell(notify: Callable[[], None]) -> None:
    """Have someone told whenever this process compiles a kernel instead of reading it from the cache.

    Loads nothing by itself. Where kernels are loaded already, nothing is told any more.
    """
    if _KERNELS not in sys.modules:
        sys.meta_path.insert(0, _BeforeKernels(notify))
