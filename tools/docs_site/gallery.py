"""The example gallery in the documentation: how its pictures are shown, where links to its scripts lead.

A Sphinx extension. Pictures are figures of plotly: each stands in its page as JSON, and one copy of plotly's script,
loaded by pages of the gallery only and from the documentation itself, draws them. Links of other pages to a script of
``examples/gallery`` lead to the page made of it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import plotly.io as pio
import polars as pl
from plotly.io.base_renderers import MimetypeRenderer
from plotly.offline import get_plotlyjs

from counterflex.report.figure_data import script_json

ROOT: Final = Path(__file__).resolve().parents[2]
SCRIPTS: Final = ROOT / "examples" / "gallery"
SECTIONS: Final = ("robot", "cutting", "compensation", "laboratory")
"""Folders of the gallery, in its order."""
PAGES: Final = "gallery"
"""Folder below ``docs`` that the pages are made in."""
HEIGHT_PX: Final = 420
_SCRIPT: Final = "plotly.min.js"
_LINK: Final = re.compile(r"\]\((?:\.\./)+examples/gallery/((?:[a-z]+/[a-z_]+\.py)|)\)")


class _InPage(MimetypeRenderer):  # type: ignore[misc]
    """Shows a figure as a place in the page and its JSON; ``figures.js`` draws it."""

    def to_mimebundle(self, fig_dict: dict[str, Any]) -> dict[str, str]:
        return {"text/html": place(fig_dict)}


def place(figure: dict[str, Any]) -> str:
    """HTML of a figure, one line.

    Args:
        figure: As plotly's JSON has it.
    """
    plain = pio.json.from_json_plotly(pio.to_json(figure, validate=False))
    height = plain["layout"].get("height", HEIGHT_PX)
    return (
        f'<div class="plotly-figure"><div style="height:{height}px"></div>'
        f'<script type="application/json">{script_json(plain)}</script></div>'
    )


def scripts() -> list[Path]:
    """Scripts of the gallery in its order."""
    return [file for section in SECTIONS for file in sorted((SCRIPTS / section).glob("*.py"))]


def to_pages(text: str, depth: int) -> str:
    """Text of a page whose links to scripts of the gallery lead to their pages.

    Args:
        text: Markdown.
        depth: Of the page below ``docs``: 0 is in it.
    """
    up = "../" * depth
    return _LINK.sub(lambda found: f"]({up}{PAGES}/{(found[1] or 'index.py')[:-3]}.rst)", text)


def _read(_app: Any, name: str, source: list[str]) -> None:
    source[0] = to_pages(source[0], name.count("/"))


def _show_in_pages(_app: Any) -> None:
    pio.renderers["page"] = _InPage()
    pio.renderers.default = "page"
    pio.templates.default = "plotly_white"
    pl.Config.set_tbl_hide_dataframe_shape(True)
    pl.Config.set_tbl_hide_column_data_types(True)
    pl.Config.set_float_precision(3)


def _scripts_of_page(app: Any, name: str, _template: str, _context: dict[str, Any], _tree: Any) -> None:
    if name.startswith(f"{PAGES}/"):
        app.add_js_file(_SCRIPT, loading_method="defer")
        app.add_js_file("figures.js", loading_method="defer")


def _copy_script(app: Any) -> None:
    folder = Path(app.outdir) / "_static"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / _SCRIPT).write_text(get_plotlyjs(), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Connect it; called by Sphinx."""
    app.connect("builder-inited", _show_in_pages, priority=100)  # before sphinx-gallery runs the scripts
    app.connect("builder-inited", _copy_script)
    app.connect("source-read", _read)
    app.connect("html-page-context", _scripts_of_page)
    app.add_css_file("gallery.css")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
