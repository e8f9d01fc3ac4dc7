"""The 3-D view of the studio: drawn by the browser from plain values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from nicegui.element import Element

from counterflex.app.panel import cell_scene
from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.studio import texts
from counterflex.app.studio.tool_way import ToolWay
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell

_SHARED: Final = str(Path(cell_scene.__file__).with_name("cell_view"))


class View(Element, component="view.js", esm={"counterflex-cell-view": _SHARED}):  # type: ignore[call-arg, misc]
    """A cell, and the way of a tool on it.

    Args:
        ready: Called when the browser can draw.
    """

    def __init__(self, ready: Callable[[], Any]) -> None:
        super().__init__()
        self._props["words"] = texts.SCENE
        self.classes("st-view-box")
        self.on("ready", lambda: ready())

    def show_cell(self, scene: CellScene, q_deg: list[float] | None = None) -> None:
        """Draw the bodies of a cell at angles of the axes in the order of the model, or at zero."""
        self.run_method("cell", scene.bodies, scene.frames([0.0] * 6 if q_deg is None else [a * DEG for a in q_deg]))

    def stand(self, scene: CellScene, cell: Cell, shown_deg: list[float], compliance_um_per_n: list[float]) -> None:
        """Move the robot to angles as the controller shows them; the ellipsoid is the deflection under 100 N."""
        import numpy as np

        q = cell.controller_chain.axes.model(np.array(shown_deg) * DEG)
        self.run_method("pose", scene.frames(q), compliance_um_per_n)

    def show_way(self, way: ToolWay, scene: CellScene, source: list[str], *, near: bool) -> None:
        """Draw the way of the tool, with the text of its program."""
        self.run_method("path", way.drawn(scene), source, near)

    def paint(self, channel: str) -> None:
        """Colour the way by a channel."""
        self.run_method("paint", channel, *texts.CHANNELS[channel])
