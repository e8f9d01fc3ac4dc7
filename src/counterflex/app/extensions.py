"""List all that can be registered by name, ours and of installed packages, each loaded to test that it works."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex.app.add_ins import ADD_INS
from counterflex.app.controller_import.frames import DATA_KINDS
from counterflex.app.plc import PLCS
from counterflex.app.robot_folder import SETUPS
from counterflex.app.run.robot_links import ROBOT_LINKS
from counterflex.core.errors import CounterflexError
from counterflex.core.registry import Registry
from counterflex.cutting.force_laws import FORCE_LAWS
from counterflex.cutting.material import OTHER_MATERIALS
from counterflex.identify.recipes import RECIPES
from counterflex.programs.language import LANGUAGES
from counterflex.protocols.force.sensors import FORCE_SENSORS
from counterflex.robot.model.catalog import OTHER_ROBOTS
from counterflex.robot.model.controller_axes import MAKERS

REGISTRIES: Final[tuple[Registry[Any], ...]] = (
    RECIPES,
    FORCE_LAWS,
    FORCE_SENSORS,
    LANGUAGES,
    MAKERS,
    DATA_KINDS,
    ROBOT_LINKS,
    SETUPS,
    PLCS,
    ADD_INS,
    OTHER_ROBOTS,
    OTHER_MATERIALS,
)


@dataclass(frozen=True)
class Extension:
    """One thing that is registered by name."""

    group: str  # Of its entry points, for example ``counterflex.force_laws``
    name: str  # As a cell file or a command line names it
    package: str
    title: str
    fault: str  # Why it cannot be used, or empty

    @classmethod
    def of(cls, registry: Registry[Any], name: str) -> Extension:
        """Load what an entry point names, and note what fails."""
        title, fault = "", ""
        try:
            entry = registry[name]
            title = str(getattr(entry, "title", entry.__doc__ if callable(entry) else entry))
        except CounterflexError as problem:
            fault = str(problem)
        return cls(registry.group, name, registry.package(name), title, fault)


def extensions(registries: Sequence[Registry[Any]] = REGISTRIES) -> list[Extension]:
    """Everything that is registered, our own first in each group."""
    return [Extension.of(registry, name) for registry in registries for name in registry]
