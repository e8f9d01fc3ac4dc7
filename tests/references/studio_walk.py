"""A walk through the studio, as a person clicks: from an empty folder to programs for three controllers and a report."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

from browser import Page

Shot = Callable[[str], None]
LANGUAGES = {"krl": "groove.src", "rapid": "groove.mod", "gcode": "groove.ngc"}
"""Languages of the walk, and the program that comes out."""


@contextlib.contextmanager
def studio(folder: Path) -> Iterator[str]:
    """A studio of a folder, as a process; the link that opens it."""
    command = [sys.executable, "-m", "counterflex", "studio", str(folder), "--port", "0", "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    try:
        yield line.strip().partition(": ")[2]
    finally:
        process.terminate()
        process.communicate()


def choose(page: Page, name: str, text: str) -> None:
    """Open a list and click on the entry with a text."""
    page.click(name)
    entry = (
        f"[...document.querySelectorAll('.q-menu .q-item')].find((one) => one.innerText.trim() === {json.dumps(text)})"
    )
    page.wait(f"!!{entry}", f"{text} is offered by {name}")
    page.value(f"{entry}.dataset.test = 'entry'")
    page.click("entry")
    page.wait("!document.querySelector('.q-menu')", f"{name} closes")


def key(page: Page, letter: str, code: int) -> None:
    """Press a key with Ctrl."""
    for kind in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key=letter, code=letter if len(letter) > 1 else f"Key{letter.upper()}",
            windowsVirtualKeyCode=code, modifiers=2,
        )  # fmt: skip


def drop(page: Page, name: str, file: Path) -> None:
    """Hand a file to a place where files are dropped."""
    root = page.call("DOM.getDocument")["root"]["nodeId"]
    selector = f"[data-test='{name}'] input[type=file]"
    node = page.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
    page.call("DOM.setFileInputFiles", nodeId=node, files=[str(file)])


def until(page: Page, name: str, words: str) -> None:
    """Wait until the strip of commands says that one has ended, and fail where another word stands there."""
    page.wait_text("now", words)
    page.wait_text("what", "done")


def cell(page: Page, shot: Shot) -> None:
    """From nothing to a cell file; a mistake in it is shown at its line."""
    page.wait("!!document.querySelector('[data-test=\"make-cell\"]')", "the first page")
    shot("empty")
    assert "counterflex cell example --out cell.toml" in page.text("page-cell")
    page.click("make-cell")
    page.wait_text("pushed", "Under 100 N")
    shot("cell")
    page.click("tab-file")
    page.wait("!!document.querySelector('.cm-content')", "the editor")
    page.value("document.querySelector('.cm-content').focus()")
    key(page, "Home", 36)
    page.call("Input.insertText", text="nonsense\n")
    page.wait_text("file-state", "Not saved")
    page.click("save")
    page.wait_text("cell-fault", "Line 1")
    shot("cell-fault")
    page.value("document.querySelector('.cm-content').focus()")
    key(page, "z", 90)
    page.click("save")
    page.wait_text("file-state", "can be used")
    assert page.text("cell-fault") == ""
    page.click("tab-not")
    page.wait_text("unknowns", "play and friction")
    shot("unknown")


def program(page: Page, shot: Shot) -> None:
    """Source line and point of the path select each other."""
    page.click("go-program")
    page.wait_text("about", "16 lines")
    page.wait("document.querySelectorAll('.st-line').length > 10", "the source")
    page.value("document.querySelector('[data-line=\"12\"]').dataset.test = 'line12'")
    page.click("line12")
    page.wait_text("at", "line 12")
    shot("program")


def plan(page: Page, shot: Shot, folder: Path) -> None:
    """Check, and compensate for three controllers; each button runs the command that it shows."""
    page.click("go-plan")
    page.click("check")
    page.wait_text("counts", "0 fail")
    for language in LANGUAGES:
        if language != "krl":
            page.click(f"as-{language}")
    page.wait_text("page-plan", "--as gcode")
    page.click("compensate")
    for language in LANGUAGES:
        page.wait(f"!!document.querySelector('[data-test=\"plan-groove-{language}\"]')", f"the plan in {language}")
    assert "expected" in page.text("bars-groove-krl").lower()
    shot("plan")
    page.click("go-program")
    choose(page, "plan-of-path", "groove-krl")
    page.wait_text("channel", "")
    page.wait("document.querySelector('.st-legend').innerText.includes('error after')", "the predicted error")
    shot("planned")


def report(page: Page, link: str) -> str:
    """Title of the report as the studio serves it: without the rights of the studio."""
    base = link.partition("?")[0]
    page.open(f"{base}files/groove-krl/report.html")
    page.wait("document.readyState === 'complete'", "the report")
    return str(page.value("document.title"))


def after_the_cut(page: Page, shot: Shot, scan: Path) -> None:
    """Prove, inspect the scan of a part, correct the next one."""
    page.click("go-plan")
    page.click("prove")
    page.wait("!!document.querySelector('[data-test=\"proof-groove-proof\"]')", "the proof")
    shot("proof")
    page.click("go-inspect")
    drop(page, "drop-scan", scan)
    page.wait_text("page-inspect", "--scan groove.ply")
    page.click("inspect")
    page.wait_text("features", "depth")
    choose(page, "made-by", "groove-krl")
    page.wait_text("page-inspect", "--plan groove-krl")
    page.click("correct")
    page.wait("!!document.querySelector('[data-test=\"next-groove-krl-next\"]')", "the next program")
    shot("inspect")
    page.click("go-run")
    page.wait_text("page-run", "counterflex panel log")
    shot("run")


def first_page_s(page: Page, link: str) -> float:
    """Time from the address to the first page that can be clicked."""
    begin = time.monotonic()
    page.open(link)
    page.wait("!!document.querySelector('[data-test=\"make-cell\"]')", "the first page")
    return time.monotonic() - begin


def status(address: str, **headers: str) -> int:
    """Status of an answer to somebody without a session."""
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=30.0) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as fault:
        return int(fault.code)
