"""Pictures of the reports as figures of plotly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import plotly.graph_objects as go

from counterflex.core.errors import InputError


def figure(pictures: Mapping[str, Any], kind: str) -> go.Figure:
    """One of some pictures.

    Args:
        pictures: Functions without arguments by name; each returns a figure as plotly's JSON has it.
        kind: Which.

    Raises:
        InputError: There is none of that name.
    """
    if kind not in pictures:
        raise InputError("no such picture", where="plot", value=kind, limit=", ".join(pictures))
    picture = pictures[kind]()
    return go.Figure({"data": picture["data"], "layout": picture["layout"]})
