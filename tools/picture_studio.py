"""Remake docs/images/studio.png: the program of the demonstration with its plan, in Chromium; all pages with --out DIR.

python tools/picture_studio.py [--out out/studio] [--width 1400]
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "references"))
import studio_walk  # noqa: E402
from browser import Browser, Page  # noqa: E402

SETTLED_S: Final = 1.5
"""Time for a page to come to rest before its picture."""


def keep(page: Page, pictures: Path, name: str) -> None:
    """Take a picture of a page that has come to rest."""
    time.sleep(SETTLED_S)
    page.screenshot(pictures / f"{name}.png")


def main(out: Path | None, width: int) -> None:
    """Walk through the studio and keep a picture of each page."""
    with tempfile.TemporaryDirectory() as made:
        pictures = Path(made) if out is None else out
        pictures.mkdir(parents=True, exist_ok=True)
        folder = Path(made) / "part-17"
        with studio_walk.studio(folder) as link, Browser(width, 860) as browser:
            page = browser.page()
            size = {"width": width, "height": 860, "deviceScaleFactor": 1, "mobile": width < 500}
            page.call("Emulation.setDeviceMetricsOverride", **size)
            page.open(link)
            shot = partial(keep, page, pictures)
            studio_walk.cell(page, shot)
            if out is not None:
                studio_walk.measure(page, shot, folder)
            studio_walk.program(page, shot)
            studio_walk.plan(page, shot)
            if out is not None:
                studio_walk.choices(page, shot)
        if out is None:
            shutil.copy(pictures / "planned.png", ROOT / "docs" / "images" / "studio.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--width", type=int, default=1400)
    given = parser.parse_args()
    main(given.out, given.width)
