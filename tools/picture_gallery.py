"""Remake the small pictures of the example gallery (docs/_static/gallery) from the built documentation.

    make docs-html
    python tools/picture_gallery.py [NAME ...]

Needs Chromium, as tools/check_pages.py. Of each page the figure is taken that :data:`FIGURE` names, else the first. A
script names its picture in ``sphinx_gallery_thumbnail_path``.
"""

from __future__ import annotations

import html
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from PIL import Image

from check_pages import run_browser
from docs_site.gallery import PAGES, ROOT, SCRIPTS, scripts

BUILT: Final = ROOT / "docs" / "_build" / "html"
PICTURES: Final = ROOT / "docs" / "_static" / "gallery"
WIDTH, HEIGHT = 400, 280
"""Of a picture in px."""
FIGURE: Final = {"cable_pulls": 0, "compensate_and_prove": 2, "friction_and_play": 0}
"""Which figure of a page, from 0, where it is not the first."""
_FIGURE: Final = re.compile(r'<div class="plotly-figure">.*?<script type="application/json">(.*?)</script>', re.DOTALL)
_WRAPPER: Final = """<html><body style="margin:0;background:#fff">
<div id="at" style="width:{width}px;height:{height}px"></div>
<script src="{plotly}"></script><script>
const figure = {figure};
const layout = Object.assign({{}}, figure.layout, {{ width: {width}, height: {height}, paper_bgcolor: "#fff",
  title: undefined, margin: Object.assign({{}}, figure.layout.margin, {{ t: 40, r: 14 }}) }});
Plotly.newPlot("at", figure.data, layout, {{ staticPlot: true, displayModeBar: false }});
</script></body></html>"""


def figures(page: str) -> list[dict[str, Any]]:
    """Figures of a built page, in order."""
    return [json.loads(html.unescape(text)) for text in _FIGURE.findall(page)]


def draw(figure: dict[str, Any], target: Path) -> None:
    """Draw a figure into a PNG file by Chromium."""
    with tempfile.TemporaryDirectory() as name:
        wrapper, picture = Path(name) / "figure.html", Path(name) / "figure.png"
        plotly = (BUILT / "_static" / "plotly.min.js").as_uri()
        text = json.dumps(figure).replace("</", "<\\/")
        wrapper.write_text(_WRAPPER.format(width=WIDTH, height=HEIGHT, plotly=plotly, figure=text), encoding="utf-8")
        run_browser(f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={picture}", wrapper.as_uri())
        with Image.open(picture) as drawn:
            drawn.convert("RGB").quantize(64).save(target, optimize=True)


def main(names: list[str]) -> int:
    """Draw the pictures of the named scripts, or of all."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for script in scripts():
        if names and script.stem not in names:
            continue
        page = BUILT / PAGES / script.relative_to(SCRIPTS).with_suffix(".html")
        found = figures(page.read_text(encoding="utf-8"))
        target = PICTURES / f"{script.stem}.png"
        draw(found[FIGURE.get(script.stem, 0)], target)
        print(f"{target.relative_to(ROOT)}: {target.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
