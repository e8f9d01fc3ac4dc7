"""Named things of counterflex and of other packages: recipes, force laws, protocols, languages, robots, materials.

A package adds one by the line ``name = "module:object"`` below ``[project.entry-points."GROUP"]`` in its
``pyproject.toml``. Each folder of ``counterflex.integrations`` states its own in the same form, ``ENTRY_POINTS`` of its
``__init__``; what belongs to no maker stands in the table of the registry. Nothing else is imported before it is asked
for by its name: a broken package stops only the commands that use it.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.metadata
import pkgutil
from collections.abc import Iterator, Mapping
from types import MappingProxyType, UnionType
from typing import Any, Final, Generic, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to

T = TypeVar("T")
_MAKERS: Final = "counterflex.integrations"


@functools.cache
def _outside(group: str) -> dict[str, tuple[importlib.metadata.EntryPoint, ...]]:
    """Entry points of installed packages by name; the same package listed twice on the path counts once."""
    results: dict[str, dict[tuple[str, str], importlib.metadata.EntryPoint]] = {}
    for point in importlib.metadata.entry_points(group=group):
        results.setdefault(point.name, {})[_package(point), point.value] = point
    return {name: tuple(points.values()) for name, points in sorted(results.items())}


def _package(point: importlib.metadata.EntryPoint) -> str:
    return "an unknown package" if point.dist is None else f"{point.dist.name} {point.dist.version}"


@functools.cache
def _of_makers() -> Mapping[str, Mapping[str, str]]:
    """``module:object`` by group and name, of all folders of makers in alphabetical order."""
    results: dict[str, dict[str, str]] = {}
    for folder in pkgutil.iter_modules(importlib.import_module(_MAKERS).__path__):
        points = importlib.import_module(f"{_MAKERS}.{folder.name}").ENTRY_POINTS
        for group, places in points.items():
            results.setdefault(group, {}).update(places)
    return results


def imported(place: str) -> Any:
    """Return the object at ``module:object``, imported now."""
    module, _, attribute = place.partition(":")
    return getattr(importlib.import_module(module), attribute)


def misfits(thing: Any) -> Iterator[str]:
    """One sentence for each field of a record, and of records in it, whose value is not of the declared type."""
    if not dataclasses.is_dataclass(thing):
        return
    declared = get_type_hints(type(thing))
    for field in dataclasses.fields(thing):
        value, kind = getattr(thing, field.name), declared[field.name]
        if not _fits(value, kind):
            shown = str(kind.__name__ if isinstance(kind, type) and not get_args(kind) else kind)
            yield f"{field.name} = {value!r:.60} is no {shown.replace('collections.abc.', '').replace('typing.', '')}"
        yield from (f"{field.name}.{wrong}" for wrong in misfits(value))


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value is of a type; True for types that cannot be tested at run time."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(value, one) for one in inner)
    if origin is Literal:
        return value in inner
    if origin is tuple:
        kinds = inner[:1] * len(value) if isinstance(value, tuple) and inner[-1:] == (...,) else inner
        return isinstance(value, tuple) and len(value) == len(kinds) and all(map(_fits, value, kinds))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(_fits(k, inner[0]) and _fits(v, inner[1]) for k, v in value.items())
    return _is_of(value, origin or kind)


def _is_of(value: Any, kind: Any) -> bool:
    """Return whether a value is an instance of a class; of what is none, and of protocols, nothing is known: True."""
    if kind in (int, float):
        return isinstance(value, int if kind is int else int | float) and not isinstance(value, bool)
    return not isinstance(kind, type) or getattr(kind, "_is_protocol", False) or isinstance(value, kind)


class Registry(Generic[T]):
    """All things of one kind by name.

    Args:
        group: Of the entry points, for example ``counterflex.force_laws``.
        what: What they are, for messages: ``force law``.
        kind: Type that a registered object must be an instance of, ``module:class``; imported with the first object.
        own: Those of counterflex that belong to no maker: ``module:object`` by name.
    """

    def __init__(self, group: str, what: str, kind: str, own: Mapping[str, str] = MappingProxyType({})) -> None:
        self.group, self.what, self.kind, self._standard = group, what, kind, own

    @functools.cached_property
    def own(self) -> dict[str, str]:
        """``module:object`` by name, of counterflex: what belongs to no maker first."""
        return {**self._standard, **_of_makers().get(self.group, {})}

    def __iter__(self) -> Iterator[str]:
        """Names, our own first."""
        return iter((*self.own, *(name for name in _outside(self.group) if name not in self.own)))

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in _outside(self.group)

    def __getitem__(self, name: str) -> T:
        """The thing of a name, imported now.

        Raises:
            InputError: There is none, two packages give the same name, or the package is broken; it is named.
        """
        points = _outside(self.group).get(name, ())
        if len(points) + (name in self.own) > 1:
            owners = ["counterflex"] * (name in self.own) + [_package(point) for point in points]
            raise InputError(
                f"two packages bring the same {self.what}",
                value=f"'{name}' of {' and of '.join(owners)}",
                hint="Remove one of the packages, or have it rename the entry point",
            )
        if name in self.own:
            result: T = imported(self.own[name])
            return result
        if not points:
            close = close_to(name, list(self), 1)
            raise InputError(
                f"there is no such {self.what}",
                value=name,
                limit=", ".join(self),
                hint=f"Did you mean '{close[0]}'?" if close else None,
            )
        return self._of_package(points[0])

    def items(self) -> Iterator[tuple[str, T]]:
        """Names and things, our own first; without those of packages that cannot be loaded."""
        for name in self:
            try:
                thing = self[name]
            except InputError:
                continue
            yield name, thing

    def broken(self) -> Iterator[str]:
        """Names of what cannot be loaded: to ask for one says why."""
        for name in self:
            try:
                self[name]
            except InputError:
                yield name

    def _of_package(self, point: importlib.metadata.EntryPoint) -> T:
        where = f"{_package(point)}: entry point {point.name} = {point.value} of {self.group}"
        hint = "Repair or remove the package; commands that do not use it work meanwhile"
        try:
            result: Any = point.load()
        except (Exception, SystemExit) as fault:
            raise InputError(
                f"the {self.what} of another package cannot be loaded: {type(fault).__name__}: {fault}",
                where=where,
                hint=hint,
            ) from fault
        if not isinstance(result, imported(self.kind)):
            raise InputError(
                f"the {self.what} of another package is of the wrong type",
                where=where,
                value=type(result).__name__,
                limit=f"an instance of {self.kind.replace(':', '.')}",
                hint=hint,
            )
        wrong = next(misfits(result), None)
        if wrong is not None:
            raise InputError(f"the {self.what} of another package has a wrong part: {wrong}", where=where, hint=hint)
        thing: T = result
        return thing

    def package(self, name: str) -> str:
        """Package and version that bring a name, ``counterflex`` for our own; several are joined by a comma."""
        points = _outside(self.group).get(name, ())
        return ", ".join(["counterflex"] * (name in self.own) + [_package(point) for point in points])
