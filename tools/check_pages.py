"""Open report pages in a browser at three widths, dark and on paper, and say what does not fit or does not work.

    python tools/check_pages.py out/demo/report.html out/report.html

Needs Chromium (Debian: apt-get install chromium), found as ``chromium`` or in CHROMIUM. Each page is opened in frames
of 360, 768 and 1280 px. A page passes when nothing is wider than its frame (tables may scroll in their own box), every
figure is drawn, no label of a figure is cut off or hides another, the script throws nothing, and the text is not too
small or too pale to read, light and dark; printed, it must come out on A4.
"""

from __future__ import annotations

import argparse
import html
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

WIDTHS: Final = (360, 768, 1280)
DARK_WIDTHS: Final = (768,)
LEAST_CONTRAST: Final = 4.5
"""Of text, WCAG 2.2, criterion 1.4.3."""
A4_PT: Final = (841.9, 595.3)
LEAST_FONT_PX: Final = 8.0
_BUDGET_MS: Final = 30_000
_FLAGS: Final = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--allow-file-access-from-files",
    "--disable-dev-shm-usage",
)
_PROBE: Final = """
const faults = [];
const look = (frame) => {
  const page = frame.contentDocument, wide = frame.clientWidth;
  const out = { width: wide, wide: [], empty: [], small: [], pale: [], cut: [], over: [], faults: [] };
  out.scroll = page.documentElement.scrollWidth;
  const style = (item) => frame.contentWindow.getComputedStyle(item);
  const numbers = (colour) => colour.match(/[.0-9]+/g).map(Number);
  const background = (item) => {
    for (let at = item; at; at = at.parentElement) {
      const colour = style(at).backgroundColor, parts = numbers(colour);
      if (parts.length < 4 || parts[3] > 0) return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const luminance = (colour) => {
    const part = numbers(colour).slice(0, 3).map((one) => one / 255)
      .map((one) => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
    return 0.2126 * part[0] + 0.7152 * part[1] + 0.0722 * part[2];
  };
  const in_box = (item) => item.closest(".scroll") !== null || item.closest("[data-figure]") !== null;
  page.querySelectorAll("body *").forEach((item) => {
    const box = item.getBoundingClientRect();
    if (box.width > 0 && box.right > wide + 1 && !in_box(item)) out.wide.push(item.tagName + "." + item.className);
  });
  page.querySelectorAll(".scroll, [data-figure]").forEach((item) => {
    if (item.getBoundingClientRect().right > wide + 1) out.wide.push(item.className + " " + item.dataset.figure);
  });
  page.querySelectorAll("[data-figure]").forEach((item) => {
    if (item.closest("details:not([open])")) return;
    const drawn = item.querySelector(".main-svg");
    if (!drawn) out.empty.push(item.dataset.figure);
    else if (drawn.getBoundingClientRect().width > item.clientWidth + 1) out.wide.push("svg of " + item.dataset.figure);
  });
  page.querySelectorAll("[data-figure]").forEach((item) => {
    const box = item.getBoundingClientRect(), labels = [];
    item.querySelectorAll(".main-svg text").forEach((text) => {
      const at = text.getBoundingClientRect(), words = text.textContent.trim();
      if (at.width === 0 || !words) return;
      if (at.left < box.left - 1 || at.right > box.right + 1) out.cut.push(item.dataset.figure + ": " + words);
    });
    item.querySelectorAll(".annotation-text-g .bg").forEach((label) => labels.push(label.getBoundingClientRect()));
    labels.forEach((a, i) => labels.slice(i + 1).forEach((b) => {
      const x = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const y = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (x > 2 && y > 2 && a.width > 0 && b.width > 0) out.over.push(item.dataset.figure);
    }));
  });
  page.querySelectorAll("p, li, td, th, dd, dt, .name, .big, label").forEach((item) => {
    const size = parseFloat(style(item).fontSize);
    if (size < SMALLEST) out.small.push(item.tagName + " " + size);
    if (!item.textContent.trim() || item.getBoundingClientRect().width === 0) return;
    const shown = luminance(style(item).color), behind = luminance(background(item));
    const contrast = (Math.max(shown, behind) + 0.05) / (Math.min(shown, behind) + 0.05);
    const words = item.textContent.trim().slice(0, 30);
    if (contrast < PALEST) out.pale.push(`${item.tagName} ${words} ${contrast.toFixed(1)}`);
  });
  out.faults = frame.contentWindow.__faults || [];
  return out;
};
window.addEventListener("load", () => setTimeout(() => {
  const found = Array.from(document.querySelectorAll("iframe")).map(look);
  document.getElementById("found").textContent = JSON.stringify(found);
}, 8000));
"""
_RECORDER: Final = "<script>window.__faults=[];window.onerror=(m)=>{window.__faults.push(String(m))};</script>"


def browser() -> str:
    """Path of Chromium.

    Raises:
        SystemExit: There is none.
    """
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        raise SystemExit("check_pages: no chromium; apt-get install chromium, or name it in CHROMIUM")
    return found


def run_browser(*arguments: str) -> str:
    """Output of Chromium with a profile of its own."""
    with tempfile.TemporaryDirectory() as profile:
        done = subprocess.run(
            [browser(), *_FLAGS, f"--user-data-dir={profile}", f"--virtual-time-budget={_BUDGET_MS}", *arguments],
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    return done.stdout


def looked_at(page: Path, folder: Path, *, dark: bool = False) -> list[dict[str, Any]]:
    """Measurements of a browser at each width, on a light screen or a dark one.

    Raises:
        SystemExit: The browser gave no answer.
    """
    watched = folder / "watched.html"
    watched.write_text(page.read_text(encoding="utf-8").replace("<head>", f"<head>{_RECORDER}", 1), encoding="utf-8")
    widths, scheme = (DARK_WIDTHS, 0) if dark else (WIDTHS, 1)
    frames = "".join(
        f'<iframe src="{watched.name}" style="width:{width}px;height:6000px;border:0"></iframe>' for width in widths
    )
    script = _PROBE.replace("SMALLEST", str(LEAST_FONT_PX)).replace("PALEST", str(LEAST_CONTRAST))
    wrapper = folder / "wrapper.html"
    wrapper.write_text(
        f'<html><body style="margin:0;display:flex">{frames}<pre id="found"></pre>'
        f"<script>{script}</script></body></html>",
        encoding="utf-8",
    )
    shown = f"--window-size={sum(widths) + 40},6000", f"--blink-settings=preferredColorScheme={scheme}"
    text = run_browser(*shown, "--dump-dom", wrapper.as_uri())
    match = re.search(r'<pre id="found">(.+?)</pre>', text, re.DOTALL)
    if match is None:
        raise SystemExit(f"check_pages: {page}: the browser gave no answer")
    found: list[dict[str, Any]] = json.loads(html.unescape(match[1]))
    return found


def printed(page: Path, folder: Path) -> list[str]:
    """Faults on paper."""
    paper = folder / "page.pdf"
    run_browser("--no-pdf-header-footer", f"--print-to-pdf={paper}", page.resolve().as_uri())
    if not paper.is_file():
        return ["printing gave no file"]
    boxes = re.findall(rb"/MediaBox \[([\d. ]+)\]", paper.read_bytes())
    sizes = {tuple(round(float(v), 1) for v in box.split()[2:]) for box in boxes}
    off = [size for size in sizes if any(abs(a - b) > 1.5 for a, b in zip(size, A4_PT, strict=True))]
    if not boxes:
        return ["the printed file has no pages"]
    return [f"printed on {size}, not on A4 landscape" for size in off]


def faults(found: dict[str, Any]) -> list[str]:
    """Faults at one width, in words."""
    out = []
    if found["scroll"] > found["width"] + 1:
        out.append(f"the page is {found['scroll']} px wide")
    out += [f"runs off the page: {item}" for item in found["wide"][:5]]
    out += [f"not drawn: {item}" for item in found["empty"]]
    out += [f"label cut off: {item}" for item in found["cut"][:5]]
    out += [f"labels over each other: {item}" for item in found["over"][:3]]
    out += [f"too small to read: {item}" for item in found["small"][:3]]
    out += [f"too pale to read: {item}" for item in found["pale"][:3]]
    out += [f"script: {item}" for item in found["faults"][:3]]
    return out


def main() -> int:
    """Check the pages that are named; the exit status is 1 where one does not pass."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("pages", nargs="+", type=Path, metavar="PAGE")
    wrong = 0
    for page in parser.parse_args().pages:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            said = {f"{found['width']} px": faults(found) for found in looked_at(page, folder)}
            said |= {f"{found['width']} px, dark": faults(found) for found in looked_at(page, folder, dark=True)}
            said["A4"] = printed(page, folder)
        for where, what in said.items():
            print(f"{page}, {where}: {'; '.join(what) if what else 'ok'}")
            wrong += bool(what)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
