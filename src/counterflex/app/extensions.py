"""List all that can be registered by name, ours and of installed packages, each loaded to test that it works."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex.app.add_ins import ADD_INS
from counterflex.app.controller_import.frames import DATA_KINDS
from counterflex.app.plc import PLCS
from counterflex.app.robot_folder import SETUPS
from counterflex.app.run.robot_links import ROBOT_LINKS
from counterflex.core.errors import CounterflexError
from counterflex.core.registry import Registry, imported
from counterflex.cutting.force_laws import FORCE_LAWS
from counterflex.cutting.material import OTHER_MATERIALS
from counterflex.identify.recipes import RECIPES
from counterflex.programs.language import LANGUAGES, Language
from counterflex.protocols.force.sensors import FORCE_SENSORS
from counterflex.robot.model.catalog import OTHER_ROBOTS
from counterflex.robot.model.controller_axes import MAKERS, Maker

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
_PLACE: Final = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
_WRITING: Final = {"tolerance_m", "cell", "job"}
_CALLS: Final = {"files": 1, "doubts": 1, "diameters": 1, "cell": 1, "write": 1, "convert": 1, "load": 3}
"""Number of arguments of the parts of a language that are called without names."""


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
            fault = next(_faults(registry, name, entry), "")
        except CounterflexError as problem:
            fault = str(problem)
        return cls(registry.group, name, registry.package(name), title, fault)


def extensions(registries: Sequence[Registry[Any]] = REGISTRIES) -> list[Extension]:
    """Everything that is registered, our own first in each group."""
    return [Extension.of(registry, name) for registry in registries for name in registry]


def _faults(registry: Registry[Any], name: str, entry: Any) -> Iterator[str]:
    """Why parts of what is registered cannot be used: each is imported and held against how it is called."""
    yield from _not_usable(entry)
    if isinstance(entry, Language) and registry is LANGUAGES:
        others = {(one.prompt or key): key for key, one in LANGUAGES.items() if key != name}
        if (entry.prompt or name) in others and name not in LANGUAGES.own:
            yield f"the name {entry.prompt or name} at the prompt is that of {others[entry.prompt or name]}"
    if isinstance(entry, Maker) and entry.language not in LANGUAGES:
        yield f"no language {entry.language} is registered, which the maker names"


def _not_usable(entry: Any) -> Iterator[str]:
    for field in dataclasses.fields(entry) if dataclasses.is_dataclass(entry) else ():
        place = part = getattr(entry, field.name)
        if isinstance(place, str) and _PLACE.fullmatch(place):
            try:
                part = imported(place)
            except Exception as fault:
                yield f"{field.name} = {place} cannot be imported: {type(fault).__name__}: {fault}"
                continue
        if isinstance(entry, Language) and part is not None:
            yield from _not_called(entry, field.name, part)


def _not_called(language: Language, field: str, part: Any) -> Iterator[str]:
    """Why a part of a language does not take the arguments that it is called with."""
    counts, names = _CALLS, set[str]()
    if field == "read":
        counts, names = {"read": 1}, {"cell" if language.robot else "machine", "complete"}
    elif field == "in_place":
        counts, names = {"in_place": 2}, {*_WRITING, "cycle_s" if language.robot else "words"}
    if field not in counts:
        return
    try:
        inspect.signature(part).bind(*range(counts[field]), **dict.fromkeys(names))
    except (TypeError, ValueError) as fault:
        yield f"{field} is not called as it must be: {fault}"
