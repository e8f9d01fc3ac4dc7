"""Options that belong together, as one argument of a command: a dataclass whose fields are the options."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

R = TypeVar("R")


def with_records(command: Callable[..., R]) -> Callable[..., R]:
    """Return a command as the parser reads it: in place of each record the options that are its fields.

    The options keep the order in which records and fields stand, which is that of ``--help``.

    Args:
        command: A function whose arguments are annotated options and arguments, or dataclasses of them.
    """
    hints = get_type_hints(command, include_extras=True)
    records: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name in records:
            parameters += _options(records[parameter.name])
        else:
            keyword, hint = inspect.Parameter.KEYWORD_ONLY, hints[parameter.name]
            parameters.append(parameter.replace(kind=keyword, annotation=hint))

    @functools.wraps(command)
    def called(**given: Any) -> R:
        made = {name: kind(**{one.name: given.pop(one.name) for one in fields(kind)}) for name, kind in records.items()}
        return command(**given, **made)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


def _options(record: Any) -> list[inspect.Parameter]:
    """Options of a record, in the order of its fields."""
    hints = get_type_hints(record, include_extras=True)
    return [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if one.default is MISSING else one.default,
            annotation=hints[one.name],
        )
        for one in fields(record)
    ]
