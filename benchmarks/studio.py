"""Speed of the studio in Chromium: first page, frames with many points, memory while a person clicks.

``python benchmarks/studio.py [--quick] [--points N] [--minutes M] [--json FILE]``. A project with one cell and one
program of N points, a zigzag of short lines. A frame is counted at each call of the browser's own
clock while the tool moves along the program: each has another point, another posture and another state of the stock.
Chromium draws without a graphics card here, so that the figure holds processor drawing; ``script`` is the time of the
page's own code per frame, which a graphics card does not take away. Needs the extra ``panel``, and Chromium.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "references"))
import studio_walk
from browser import Browser, Page, chromium
from counterflex.app import examples
from counterflex.app.environment import environment

STEPS: Final = ("cell", "measure", "program", "plan", "inspect", "run")
MB: Final = 1024.0
WATCHED: Final = """new Promise((done) => {
    const slider = document.querySelector('[data-test="time"]'), times = [], spent = [];
    const step = (now) => { times.push(now); const begin = performance.now();
        slider.value = (times.length * 37) % slider.max; slider.dispatchEvent(new Event('input'));
        spent.push(performance.now() - begin);
        if (now - times[0] < SECONDS * 1000) requestAnimationFrame(step);
        else done([(times.length - 1) / (now - times[0]) * 1000, spent.sort((a, b) => a - b)[spent.length >> 1]]); };
    requestAnimationFrame(step); })"""
"""Moves the slider at each frame: frames a second, and the median time of the page's own code, ms."""


def zigzag(count: int) -> str:
    """G-code of a facing of the small blank in a number of short lines."""
    rows = max(2, round((count / 8.0) ** 0.5))
    lines = ["G17 G21 G54 G90", "T1 M6", "G43 H1", "S13000 M3", "G0 Z60", "G0 X-12 Y-12", "G1 Z39.5 F1500"]
    along = np.linspace(-12.0, 72.0, count // rows)
    for k, y in enumerate(np.linspace(-12.0, 72.0, rows)):
        lines += [f"G1 X{x:.3f} Y{y:.3f}" for x in (along if k % 2 == 0 else along[::-1])]
    return "\n".join([*lines, "G0 Z60", "M5", "M30", ""])


def resident_mb(process: int) -> float:
    """Memory of a process of this computer."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return float(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / MB


def spent_s(process: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def clicked(page: Page, process: int, minutes: float) -> list[dict[str, float]]:
    """Click through all pages and along the program; memory at the beginning and each minute."""
    out: list[dict[str, float]] = []
    begin, clicks = time.monotonic(), 0
    while not out or time.monotonic() - begin < 60.0 * minutes:
        for step in STEPS:
            studio_walk.click(page, f"go-{step}")
            clicks += 1
            if step == "program":
                studio_walk.to_share(page, (clicks % 10) / 10)
        if time.monotonic() - begin >= 60.0 * len(out):
            heap = float(page.value("performance.memory.usedJSHeapSize")) / MB**2
            passed = time.monotonic() - begin
            out.append({"s": passed, "clicks": clicks, "server_mb": resident_mb(process), "page_mb": heap})
            print("{s:5.0f} s {clicks:5.0f} clicks: studio {server_mb:.0f} MB, page {page_mb:.0f} MB".format(**out[-1]))
    return out


def main(points: int, minutes: float, seconds: float) -> dict[str, Any]:
    """Measure all three."""
    with tempfile.TemporaryDirectory() as made, Browser(1400, 900) as browser:
        folder = Path(made) / "part"
        folder.mkdir()
        (folder / "cell-small.toml").write_text(examples.small(), encoding="utf-8")
        (folder / "zigzag.ngc").write_text(zigzag(points), encoding="ascii")
        with studio_walk.studio(folder) as link:
            found = subprocess.run(["pgrep", "-f", f"studio {folder}"], capture_output=True, text=True, check=True)
            process = int(found.stdout.split()[0])
            page = browser.page()
            begin, worked = time.monotonic(), spent_s(process)
            page.open(link)
            page.wait("!!document.querySelector('[data-test=\"go-program\"]')", "the first page")
            first, first_cpu = time.monotonic() - begin, spent_s(process) - worked
            page.wait_text("pushed", "Under 100 N")
            studio_walk.click(page, "go-program")
            page.wait("!!document.querySelector('[data-test=\"stock\"]')", "the stock")
            drawn = time.monotonic() - begin
            frames, script = page.value(WATCHED.replace("SECONDS", str(seconds)))
            memory = clicked(page, process, minutes)
    print(f"first page {first:.1f} s ({first_cpu:.2f} s of the studio's processor)")
    print(f"program of {points} lines with its stock {drawn:.1f} s")
    print(f"{frames:.1f} frames a second drawn by the processor; script {script:.2f} ms a frame")
    return {
        "first_page_s": first, "first_page_cpu_s": first_cpu, "drawn_s": drawn, "points": points,
        "frames_per_s": frames, "script_ms": script, "memory": memory, "environment": environment(),
    }  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small program, few seconds")
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if chromium() is None:
        sys.exit("no Chromium on this computer")
    brief = given.quick
    figures = main(2000 if brief else given.points, 0.0 if brief else given.minutes, 2.0 if brief else 10.0)
    if given.json is not None:
        given.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
