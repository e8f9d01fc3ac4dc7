"""A walk through the studio, as a person clicks: from an empty folder to programs for three controllers."""

from __future__ import annotations

import contextlib
import csv
import json
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

from browser import Page

Shot = Callable[[str], None]
LANGUAGES = {"krl": "groove.src", "rapid": "groove.mod", "gcode": "groove.ngc"}
"""Languages of the walk, and the program that comes out."""
_COMMAND_S = 1800.0
"""Longest time that a command may take: a proof of 40 s took more than 180 s beside other work on two cores."""


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


def click(page: Page, name: str) -> None:
    """Scroll to an element, as a person does, and click on it."""
    page.value(f"document.querySelector('[data-test=\"{name}\"]').scrollIntoView({{ block: 'center' }})")
    page.click(name)


def made(page: Page, name: str, word: str = "") -> None:
    """Wait until a command has made an element with a word; a command that fails ends the wait at once."""
    shown = f"(document.querySelector('[data-test=\"{name}\"]')?.innerText ?? null)?.includes({json.dumps(word)})"
    found = page.wait(f"document.querySelector('.st-failed') ? 'failed' : {shown} && 'made'", name, _COMMAND_S)
    assert found == "made", page.text("commands")


def choose(page: Page, name: str, text: str) -> None:
    """Open a list and click on the entry with a text."""
    click(page, name)
    entry = (
        f"[...document.querySelectorAll('.q-menu .q-item')].find((one) => one.innerText.trim() === {json.dumps(text)})"
    )
    page.wait(f"!!{entry}", f"{text} is offered by {name}")
    page.value(f"{entry}.dataset.test = 'entry'")
    click(page, "entry")
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


def cell(page: Page, shot: Shot) -> None:
    """From nothing to a cell file; a mistake in it is shown at its line."""
    page.wait("!!document.querySelector('[data-test=\"make-cell\"]')", "the first page")
    shot("empty")
    assert "counterflex cell example --out cell.toml" in page.text("page-cell")
    click(page, "make-cell")
    page.wait_text("pushed", "Under 100 N")
    shot("cell")
    click(page, "tab-file")
    page.wait("!!document.querySelector('.cm-content')", "the editor")
    page.value("document.querySelector('.cm-content').focus()")
    key(page, "Home", 36)
    page.call("Input.insertText", text="nonsense\n")
    page.wait_text("file-state", "Not saved")
    click(page, "save")
    page.wait_text("cell-fault", "Line 1")
    shot("cell-fault")
    page.value("document.querySelector('.cm-content').focus()")
    key(page, "z", 90)
    click(page, "save")
    page.wait_text("file-state", "can be used")
    assert page.text("cell-fault") == ""
    click(page, "tab-not")
    page.wait_text("unknowns", "play and friction")
    shot("unknown")


def enter(page: Page, name: str, text: str) -> None:
    """Type into a field in place of what is there."""
    click(page, name)
    page.value("document.activeElement.select()")
    page.call("Input.insertText", text=text)
    page.value("document.activeElement.blur()")


def paste(page: Page, name: str, block: list[list[str]]) -> None:
    """Paste a block of a spreadsheet into the cell of a table."""
    text = json.dumps("\n".join("\t".join(row) for row in block))
    page.value(f"""(() => {{ const data = new DataTransfer(); data.setData('text/plain', {text});
        document.querySelector('[data-test="{name}"]').dispatchEvent(
            new ClipboardEvent('paste', {{ clipboardData: data, bubbles: true, cancelable: true }})); }})()""")


def simulated(folder: Path) -> list[dict[str, str]]:
    """Readings of the proposed poses, as a simulated cell shows them that is another one than the cell file."""
    for command in (
        "truth cell-small.toml --seed 1 --out truth.toml",
        "twin measure measure-tracker-frame/proposal.toml --cell cell-small.toml --truth truth.toml --out measured",
    ):
        line = [sys.executable, "-m", "counterflex", *command.split()]
        subprocess.run(line, cwd=folder, check=True, capture_output=True)
    with (folder / "measured" / "tracker-frame.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


READ = [f"p_tracker_target_{axis}_mm" for axis in "xyz"] + [f"R_tracker_target_r{axis}_deg" for axis in "xyz"]


def measure(page: Page, shot: Shot, folder: Path) -> None:
    """Type what a tracker shows at proposed poses; mistakes are named beside their row; the cell file is updated."""
    click(page, "go-measure")
    enter(page, "count", "12")
    page.wait_text(
        "page-measure", "identify tracker-frame --propose 12 --cell cell-small.toml --out measure-tracker-frame"
    )
    click(page, "propose")
    made(page, "row-12")
    readings = [[f"{float(row[name]):.4f}" for name in READ] for row in simulated(folder)]
    enter(page, "sigma-p_tracker_target-mm", "0.02")
    enter(page, "sigma-R_tracker_target-deg", "0.003")
    paste(page, f"cell-1-{READ[0]}", readings[:11])
    page.wait_text("row-12", "not measured")
    for column, right, wrong, word in (
        (0, readings[2][0], f"{float(readings[2][0]) * 1e3:.1f}", "wrong unit"),
        (1, readings[2][1].replace(".", ","), "1,2,3", "no number"),
        (2, readings[2][2], "", "missing: z"),
        (2, readings[2][2], f"{float(readings[2][2]) + 30.0:.4f}", "outlier"),
    ):
        enter(page, f"cell-3-{READ[column]}", wrong)
        page.wait_text("row-3", word)
        shot(f"measure-{word.split()[0].strip(':')}")
        enter(page, f"cell-3-{READ[column]}", right)
        page.wait("document.querySelector('[data-test=\"row-3\"]').innerText === ''", "nothing is wrong")
    page.wait_text("checked", "11 of 12")
    page.wait_text("checked", "0 outliers")
    click(page, "identify")
    made(page, "next")  # what to measure
    assert " to " in page.text("parameters")  # intervals
    shot("identified")
    from_a_file(page, shot, folder, readings)
    click(page, "take-cell")
    page.wait_text("page-measure", "--cell tracker-frame-identified/cell.toml")
    choose(page, "cell", "cell-small.toml")


def from_a_file(page: Page, shot: Shot, folder: Path, readings: list[list[str]]) -> None:
    """The file of a tracker as it wrote it: a title, units in a row, decimal commas, no joint angles."""
    rows = [";".join([str(k + 1), *(value.replace(".", ",") for value in row)]) for k, row in enumerate(readings)]
    text = ["Tracker session 7", "No;X;Y;Z;RX;RY;RZ", ";mm;mm;mm;deg;deg;deg", *rows]
    (folder / "measured" / "tracker.csv").write_text("\n".join(text), encoding="utf-8")
    page.value("[...document.querySelectorAll('[data-test=\"source\"] button')][1].dataset.test = 'from-file'")
    click(page, "from-file")
    drop(page, "drop-readings", folder / "measured" / "tracker.csv")
    page.wait_text("checked", "12 rows in tracker.csv")
    enter(page, "sigma-p_tracker_target-1", "0.02")
    enter(page, "sigma-R_tracker_target-1", "0.003")
    page.wait_text("checked", "0 outliers")
    shot("mapped")
    page.value("document.querySelector('[data-test=\"take-cell\"]').dataset.old = '1'")
    click(page, "identify")
    page.wait_text("now", "tracker-frame-file.toml")
    made(page, "what", "done")
    # The card is made anew after the command: a click on the former one goes nowhere.
    page.wait("!!document.querySelector('[data-test=\"take-cell\"]:not([data-old])')", "the new values")


CHANGES = "document.querySelector('[data-test=\"stock\"]').dataset.changes"
"""Cells of the stock that were lowered."""


def to_share(page: Page, share: float) -> None:
    """Move the slider along the program."""
    slider = "document.querySelector('[data-test=\"time\"]')"
    page.value(f"{slider}.value = Math.round({share} * {slider}.max); {slider}.dispatchEvent(new Event('input'))")


def program(page: Page, shot: Shot) -> None:
    """Source line and point of the path select each other."""
    click(page, "go-program")
    page.wait_text("about", "16 lines")
    page.wait("document.querySelectorAll('.st-line').length > 10", "the source")
    page.value("document.querySelector('[data-line=\"12\"]').dataset.test = 'line12'")
    click(page, "line12")
    page.wait_text("at", "line 12")
    shot("program")
    page.wait("!!document.querySelector('[data-test=\"stock\"]')", "the stock")
    to_share(page, 0.6)
    shot("stock")
    cut = int(page.value(CHANGES))
    to_share(page, 0.3)
    assert 0 < int(page.value(CHANGES)) < cut  # back in time there is more of it


def plan(page: Page, shot: Shot) -> None:
    """Compensate for three controllers: a button runs the commands that it shows."""
    click(page, "go-plan")
    for language in LANGUAGES:
        if language != "krl":
            click(page, f"as-{language}")
    page.wait_text("page-plan", "--as gcode")
    click(page, "compensate")
    for language in LANGUAGES:
        made(page, f"plan-groove-{language}")
    assert "expected" in page.text("bars-groove-krl").lower()
    shot("plan")
    click(page, "go-program")
    choose(page, "plan-of-path", "groove-krl")
    page.wait_text("channel", "")
    page.wait("document.querySelector('.st-legend').innerText.includes('error after')", "the predicted error")
    shot("planned")


def choices(page: Page, shot: Shot) -> None:
    """Posture and compensation side by side; the posture's cell is taken, and given back."""
    click(page, "go-plan")
    click(page, "posture")
    made(page, "choices", "groove-posture")
    assert "groove-krl" in page.text("choices")
    assert " %" in page.text("choices")
    shot("choices")
    click(page, "take-groove-posture")
    page.wait_text("page-plan", "--cell groove-posture/cell.toml")
    choose(page, "cell", "cell-small.toml")


def report(page: Page, link: str) -> str:
    """Title of the report as the studio serves it: without the rights of the studio."""
    base = link.partition("?")[0]
    page.open(f"{base}files/groove-krl/report.html")
    page.wait("document.readyState === 'complete'", "the report")
    return str(page.value("document.title"))


def after_the_cut(page: Page, shot: Shot, scan: Path) -> None:
    """Check, prove, inspect the scan of a part, correct the next one."""
    click(page, "go-plan")
    click(page, "check")
    made(page, "counts", "0 fail")
    shot("checked")
    click(page, "prove")
    made(page, "proof-groove-proof")
    shot("proof")
    click(page, "go-inspect")
    drop(page, "drop-scan", scan)
    page.wait_text("page-inspect", "--scan groove.ply")
    click(page, "inspect")
    made(page, "features", "depth")
    choose(page, "made-by", "groove-krl")
    page.wait_text("page-inspect", "--plan groove-krl")
    click(page, "correct")
    made(page, "next-groove-krl-next")
    page.wait_text("history", "expected of the next part")
    click(page, "accept-groove-krl-next")
    page.wait_text("page-inspect", "shows an earlier part")  # the scan is not taken for the next part
    shot("inspect")
    click(page, "go-run")
    page.wait_text("page-run", "counterflex panel log")
    shot("run")


def first_page_s(page: Page, link: str) -> float:
    """Time from the address to the first page that can be clicked."""
    begin = time.monotonic()
    page.open(link)
    page.wait("!!document.querySelector('[data-test=\"make-cell\"]')", "the first page")
    return time.monotonic() - begin


def answer(address: str, *, key: str = "", **headers: str) -> str:
    """Text of an answer, or its status where it is refused.

    Args:
        key: Link that is opened before; none: a stranger asks.
    """
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        if key:
            opener.open(key, timeout=60.0).close()
        with opener.open(urllib.request.Request(address, headers=headers), timeout=60.0) as given:
            return str(given.read().decode("utf-8", "replace"))
    except urllib.error.HTTPError as fault:
        return str(fault.code)
