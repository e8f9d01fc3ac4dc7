"""Common parts of the results of the Python interface: a short text, a table in a notebook, pictures by name."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from counterflex.core.errors import InputError

if TYPE_CHECKING:
    import plotly.graph_objects as go
    import polars as pl

Figure = Callable[[], Mapping[str, Any]]
"""Function that returns a figure as plotly's JSON has it."""


class Result(ABC):
    """Base of the results: ``repr`` of at most five lines, a table in a notebook, ``plot`` by the name of a picture."""

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
