"""Counterflex: plan, prove and correct the elastic deflection of milling robots.

``import counterflex as cf`` gives the names of :mod:`counterflex.api`; each loads what it needs when it is first used.
``__init__.pyi`` tells type checkers where they come from; here an import would point upward from every module.
"""

import importlib as _importlib
import sys as _sys
import types as _types

__version__ = "0.1.0"

_MODULES = {
    "cell": ("Cell", "compliance", "deflection", "forward", "inverse", "read_cell"),
    "errors": ("CounterflexError",),
    "examples": ("examples",),
    "identification": ("identify", "propose"),
    "modes": ("modes",),
    "part": ("Part", "compare", "inspect", "prove"),
    "plan": ("Plan", "choose_posture", "compensate", "preflight"),
    "process": ("engagement", "forces"),
    "program": ("Program", "read_program"),
    "run_log": ("RunLog", "read_run"),
    "simulated_cell": ("SimulatedCell", "simulate"),
}
"""Names of each module of the package ``counterflex.api``."""
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = tuple(sorted(_HOME))


def _loaded(name: str) -> object:
    return getattr(_importlib.import_module(f"{__name__}.api.{_HOME[name]}"), name)


class _Package(_types.ModuleType):
    """The package, whose function ``identify`` keeps its name beside the folder of the recipes.

    Python binds a folder to its name in the package when something in it is imported; modules there are imported from
    it (``from counterflex.identify import recipe``), never reached through the package.
    """

    @property
    def identify(self) -> object:
        """Function of the interface."""
        return _loaded("identify")

    @identify.setter
    def identify(self, folder: object) -> None:
        """Let the import of the folder pass."""


def __getattr__(name: str) -> object:
    """Load a name of the interface when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _loaded(name)


def __dir__() -> list[str]:
    """Return the names of the interface."""
    return [*__all__, "__version__"]


_sys.modules[__name__].__class__ = _Package
