"""Results: plain values as their JSON has them, with the lines and tables that prompt, notebook and page show.

The columns of a table are one text: ``feature | nominal mm:.3f | held %=probability!p:.1f``. A column has a heading,
behind ``=`` the name of its value where the heading is another (or a text with values in braces), and the form of
numbers. Values are written as :meth:`str.format` does, with these differences: a list is written number by number;
``!p`` is percent, ``!w`` words instead of an identifier; ``:D4`` is four digits; ``:, in %s`` is a text around a value,
empty where it is None; a name that ends with ``?`` may be missing. A text with a value that is None or missing is
empty, or it is what stands behind ``~``.
"""

from __future__ import annotations

import html
import string
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from counterflex.core.errors import InputError

if TYPE_CHECKING:
    import plotly.graph_objects as go
    import polars as pl

Figure = Callable[[], Mapping[str, Any]]
"""Function that returns a figure as plotly's JSON has it."""


class _Missing(Exception):
    """A value of a text is None."""


class _Attributes(dict[str, Any]):
    """Attributes of an object by name."""

    def __init__(self, of: object) -> None:
        self._of = of

    def __missing__(self, name: str) -> Any:
        return getattr(self._of, name)


class _Text(string.Formatter):
    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        try:
            return super().get_field(field_name.removesuffix("?"), args, kwargs)
        except (KeyError, IndexError):
            if not field_name.endswith("?"):
                raise
        except TypeError as fault:  # a part of something that is None is None
            if "NoneType" not in str(fault):
                raise
        return None, field_name

    def convert_field(self, value: Any, conversion: Any) -> Any:
        if isinstance(value, list | tuple):
            return [self.convert_field(one, conversion) for one in value]
        if value is None:
            return None
        if conversion == "p":
            return 100.0 * value
        return value.replace("_", " ") if conversion == "w" else super().convert_field(value, conversion)

    def format_field(self, value: Any, format_spec: str) -> str:
        if "%" in format_spec[:-1]:
            return "" if value in (None, "") else format_spec % value
        if value is None:
            raise _Missing
        if isinstance(value, list | tuple):
            return ", ".join(self.format_field(one, format_spec) for one in value)
        if isinstance(value, str) or (isinstance(value, int) and format_spec == "g"):
            return str(value)  # :g would write a million as 1e+06
        return digits_of(value, int(format_spec[1:])) if format_spec[:1] == "D" else format(value, format_spec)


_TEXT = _Text()


def digits_of(value: float, digits: int) -> str:
    """A number with so many significant digits; without an exponent from 0.0001 to 1e7."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def fill(template: str, row: Any, missing: str = "") -> str:
    """Return a text with the values of a row in it.

    Args:
        row: Values by name, by number, or an object with attributes.
        missing: What is returned where one of its values is None.
    """
    try:
        if isinstance(row, list | tuple):
            return _TEXT.vformat(template, row, {})
        return _TEXT.vformat(template, (), row if isinstance(row, Mapping) else _Attributes(row))
    except _Missing:
        return missing


@dataclass(frozen=True)
class ShownTable:
    """A table as it is printed, and what it was made from."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    source: Sequence[Any] = ()

    @classmethod
    def of(cls, title: str, columns: str, rows: Iterable[Any], note: str = "") -> ShownTable:
        """Table of declared columns, see above, and of rows as :func:`fill` reads them."""
        declared, source = [_column(one) for one in columns.split("|")], list(rows)
        cells = [[fill(template, row, missing) for _, template, missing in declared] for row in source]
        return cls(title, [heading for heading, _, _ in declared], cells, note, source)

    def frame(self) -> pl.DataFrame:
        """The table with its values as numbers, all that its rows hold."""
        import polars as pl

        if self.source and isinstance(self.source[0], Mapping):
            return pl.DataFrame(list(self.source), infer_schema_length=None, strict=False)
        return pl.DataFrame(self.rows, schema=list(self.columns), orient="row")


def _column(declared: str) -> tuple[str, str, str]:
    """Heading, template and text in place of None."""
    text, _, missing = declared.strip().partition("~")
    heading, named, template = text.rpartition("=")
    if not named:
        heading, colon, form = text.partition(":")
        template = heading.replace(" ", "_") + colon + form
    return heading, template if "{" in template else f"{{{template}}}", missing


class PlainLine(str):
    """A line as it is, braces and all."""


class Warned(PlainLine):
    """A line that warns."""


Part = str | Warned | ShownTable
"""A line or a table that shows a result."""
Parts = Iterator[Part]
"""Lines and tables in the order of the prompt."""


class Result(ABC):
    """Base of results: ``repr`` of at most five lines, a table in a notebook, ``plot`` by the name of a picture."""

    @property
    @abstractmethod
    def table(self) -> pl.DataFrame:
        """Data in shop units; the columns name them."""

    @property
    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Plain values, as the summary file of the command."""

    @abstractmethod
    def _lines(self) -> list[str]:
        """At most five lines that say what it is and its figures to plan with."""

    def _pictures(self) -> dict[str, Figure]:
        """Pictures by name, the usual one first."""
        return {}

    def plot(self, kind: str | None = None) -> go.Figure:
        """Return a picture.

        Args:
            kind: Name of the picture; None is the usual one. An unknown name raises an error that lists them.

        Raises:
            InputError: There is no such picture.
        """
        import plotly.graph_objects as go

        pictures = self._pictures()
        name = next(iter(pictures), "") if kind is None else kind
        if name not in pictures:
            raise InputError("no such picture", where="plot", value=name, limit=", ".join(pictures) or "none here")
        picture = pictures[name]()
        return go.Figure({"data": picture["data"], "layout": picture["layout"]})

    def __repr__(self) -> str:
        return "\n".join(self._lines()[:5])

    def _repr_html_(self) -> str:
        text = "<br>".join(html.escape(line) for line in self._lines()[:5])
        return f"<p>{text}</p>{self.table._repr_html_()}"


class Summary(Result, dict[str, Any]):
    """Plain values by name, as ``--json`` and ``summary.json`` have them, that say how they are shown."""

    @abstractmethod
    def _shown(self) -> Iterator[Part]:
        """Lines and tables, in the order of the prompt."""

    def parts(self) -> Iterator[Part]:
        """Lines and tables that show the result, in the order of the prompt."""
        return self._shown()

    def line(self, template: str, row: Any = None) -> str:
        """A line with values of the result, or of a row of it, see :func:`fill`."""
        return fill(template, self if row is None else row)

    def each(self, key: str, template: str) -> Iterator[str]:
        """A line for each row of a list, or for each text of it (``{}``)."""
        for row in self[key]:
            yield fill(template, (row,) if isinstance(row, str) else row)

    def rows(self, key: str, title: str, columns: str, note: str = "") -> ShownTable:
        """A table of the rows that the result has under a key; title and note hold values of the result."""
        return ShownTable.of(self.line(title), columns, self[key], self.line(note))

    @property
    def table(self) -> pl.DataFrame:
        """First table that is shown; its columns have the names of the values."""
        import polars as pl

        return next((part.frame() for part in self.parts() if isinstance(part, ShownTable)), pl.DataFrame())

    @property
    def summary(self) -> dict[str, Any]:
        """Itself."""
        return self

    def _lines(self) -> list[str]:
        return [part.title if isinstance(part, ShownTable) else part for part in self.parts()]


class Lines(Summary):
    """Values that are shown by lines with values in braces, and by tables."""

    def __init__(self, values: Mapping[str, Any], *parts: Part) -> None:
        super().__init__(values)
        self._given = parts

    def _shown(self) -> Iterator[Part]:
        return (self.line(part) if type(part) is str else part for part in self._given)
