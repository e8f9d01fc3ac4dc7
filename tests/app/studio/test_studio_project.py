"""A folder as a project: its files, the text of a cell, the way of the tool, the queue of commands."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import counterflex as cf
from counterflex.app import examples
from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.studio.cell_text import CellValues, line_of, with_values
from counterflex.app.studio.inspect_page import feature_rows
from counterflex.app.studio.jobs import LOG, CommandQueue, QueuedCommand
from counterflex.app.studio.project import Project
from counterflex.app.studio.texts import WITHIN
from counterflex.app.studio.tool_way import POINTS, ToolWay, pushed
from counterflex.core.errors import CounterflexError
from counterflex.core.next_command import next_command
from counterflex.cutting import material
from counterflex.files.cell.cell import read_cell

HELD_S = 120.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the demonstration cell, and a plan."""
    made = tmp_path_factory.mktemp("project")
    examples.write_all(made / "cell.toml")
    cf.compensate(made / "groove.ngc", made / "cell-small.toml", predict=False).save(made / "plan")
    return made


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("mc = 0.25", "mc = 7", "mc = 7"),
        ("flutes = 3", "flutes = ", "flutes = "),
        ("number = 1", "number = 1\nfoo = 3", "foo = 3"),
        ("mass_kg = 75", "mass_kg = -75", "mass_kg = -75"),  # of the second body
        ('catalog = "kuka_kr300_r2500_ultra"', 'catalog = "none"', 'catalog = "none"'),
        ('shoulder = "front"', 'shoulder = "left"', 'shoulder = "left"'),
    ],
)
def test_a_fault_is_shown_at_its_line(folder: Path, tmp_path: Path, old: str, new: str, line: str) -> None:
    text = (folder / "cell-small.toml").read_text(encoding="utf-8").replace(old, new)
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    with pytest.raises(CounterflexError) as told:
        read_cell(tmp_path / "cell.toml")
    number = line_of(text, told.value)
    assert number is not None
    assert text.splitlines()[number - 1] == line


@pytest.mark.parametrize("name", ["en-aw-6082-carbide-189", "en-aw-7075-linear-190"])
def test_a_form_changes_what_it_says_and_no_other_line(folder: Path, tmp_path: Path, name: str) -> None:
    text = (folder / "cell-small.toml").read_text(encoding="utf-8")
    changed = with_values(text, material=name, tool=(0, {"flutes": 2.0, "overhang_mm": 60.0}), part={"x_mm": 1300.5})
    kept = set(changed.splitlines()) & set(text.splitlines())
    assert set(changed.splitlines()) - kept == {
        f'catalog = "{name}"',
        "flutes = 2",
        "overhang_mm = 60",
        "x_mm = 1300.5",
    }
    assert {line for line in text.splitlines() if line.startswith("#")} <= kept
    (tmp_path / "cell.toml").write_text(changed, encoding="utf-8")
    cell = read_cell(tmp_path / "cell.toml")
    assert cell.tables.material is not None
    assert cell.force_law.source == material.load(name).law().source
    chosen = CellValues.of(changed)
    assert chosen is not None
    assert (chosen.material, chosen.tools[0]["flutes"]) == (name, 2)
    assert CellValues.of("a = ") is None


def test_a_folder_says_what_its_files_are(folder: Path) -> None:
    project = Project(folder)
    assert project.cells() == ["cell-small.toml", "cell.toml"]
    assert project.programs() == ["groove.ngc", "part.ngc"]
    assert project.plans("groove.ngc") == ["plan"]
    assert project.plans("part.ngc") == []
    assert project.inside("plan/plan.parquet") is not None
    assert project.inside("../" + folder.name) is None
    assert project.inside("../../../../../../etc/passwd") is None


def test_results_of_another_cell_are_told(tmp_path: Path) -> None:
    (tmp_path / "plan").mkdir()
    for name in ("cell.toml", "other.toml"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    inputs = {"cell_sha256": hashlib.sha256(b"cell.toml").hexdigest()}
    (tmp_path / "plan" / "summary.json").write_text(json.dumps({"job": "compensate", "inputs": inputs}))
    project = Project(tmp_path)
    assert project.made_with("plan", "cell.toml")
    assert not project.made_with("plan", "other.toml")
    assert project.made_with("plan", "")  # no cell is chosen yet


def test_a_feature_that_the_scan_does_not_hold_is_not_found() -> None:
    seen = {"worst_mm": 12.14, "within": True}
    feature = {"feature": "groove 1", "quantity": "width", "nominal_mm": 12.0, "tolerance_mm": 0.2}
    rows = feature_rows([{**feature, "part": seen}, feature])
    assert [row[2] for row in rows] == ["12.140 (12)", "not found (12)"]
    assert [row[4] for row in rows] == [WITHIN[True], WITHIN[None]]


def test_the_way_of_the_tool_is_that_of_the_plan(folder: Path) -> None:
    cell = folder / "cell-small.toml"
    way = ToolWay.of_program(folder / "groove.ngc", cell)
    assert way.about["length"] == pytest.approx(18.0 + 8.0 + 84.0 + 26.0)  # by the words of the program
    assert way.q is not None
    planned = way.with_plan(folder / "plan" / "plan.parquet", cell)
    table = cf.compensate(folder / "groove.ngc", cell, predict=False).table
    np.testing.assert_allclose(planned.p_part, table.select("x_mm", "y_mm", "z_mm").to_numpy(), atol=1e-9)
    force = np.linalg.norm(table.select("fx_n", "fy_n", "fz_n").to_numpy(), axis=1)
    np.testing.assert_allclose(planned.values["force"], force)
    scene = CellScene(cell)
    assert planned.q is not None
    for row in (0, len(planned.p_part) - 1):  # the robot holds the tip where the path is
        frames = scene.frames(planned.q[row])
        R, p = np.reshape(frames["part"][:9], (3, 3)), np.array(frames["part"][9:])
        np.testing.assert_allclose(R.T @ (np.array(frames["tcp"][9:]) - p) * 1e3, planned.p_part[row], atol=0.05)
    drawn = way.drawn(scene)
    assert drawn["points"] == len(drawn["line"]) == len(drawn["p"]) / 3 <= POINTS
    assert len(drawn["poses"]) == len(drawn["posed"])


def test_the_softest_direction_is_softer_than_any_axis(folder: Path) -> None:
    cell = cf.read_cell(folder / "cell-small.toml")
    angles = [1.8, -102.3, 131.2, -176.3, 28.9, 176.8]
    answer = pushed(cell.model, angles)
    C_um_per_n = cf.compliance(cell, angles)[:3, :3]
    np.testing.assert_allclose(answer["along_um"], 100.0 * np.linalg.norm(C_um_per_n, axis=0), rtol=1e-4)
    assert answer["softest_um"] == pytest.approx(100.0 * np.linalg.norm(C_um_per_n, 2), rel=1e-4)
    assert answer["softest_um"] >= max(answer["along_um"])


def test_axes_of_unknown_stiffness_are_named_beside_the_deflection(tmp_path: Path) -> None:
    """The deflection of such a robot is that of its end effector alone."""
    examples.write_all(tmp_path / "cell.toml", "abb_irb6700_235_265")
    cell = read_cell(tmp_path / "cell.toml")
    assert cell.unknown_axes
    (warning,) = pushed(cell, [0.0, 0.0, 0.0, 0.0, 30.0, 0.0])["warnings"]
    assert "unknown stiffness" in warning


def ended(queue: CommandQueue, *jobs: QueuedCommand) -> None:
    """Wait until commands have ended."""
    waiting = threading.Event()
    for _ in range(int(HELD_S / 0.05)):
        if all(job.ended and (job.status is not None or job.state == "cancelled") for job in jobs):
            return
        waiting.wait(0.05)
    raise TimeoutError([job.state for job in jobs])


def test_commands_run_one_after_the_other_and_say_what_is_wrong(tmp_path: Path) -> None:
    queue = CommandQueue(tmp_path)
    try:
        first = queue.add("counterflex cell example --out 'my cell.toml'")
        second = queue.add("counterflex cell example --out 'my cell.toml'")
        third = queue.add("counterflex robots")
        queue.cancel(third)
        ended(queue, first, second, third)
    finally:
        queue.close()
    assert (first.state, second.state, third.state) == ("done", "failed", "cancelled")
    assert (tmp_path / "my cell.toml").is_file()
    assert "my cell.toml" in second.error
    assert third.status is None
    kept = (tmp_path / LOG).read_text(encoding="utf-8").splitlines()
    assert kept == [f"{first.line}  # exit 0", f"{second.line}  # exit 2"]


def test_a_command_that_runs_can_be_cancelled_and_leaves_nothing(tmp_path: Path) -> None:
    examples.write_all(tmp_path / "cell.toml")
    before = {path.name for path in tmp_path.iterdir()}
    queue = CommandQueue(tmp_path)
    try:
        job = queue.add("counterflex prove part.ngc --cell cell.toml --out proof --seeds 50 --workers 1")
        waiting = threading.Event()
        while job.state == "waiting":
            waiting.wait(0.01)
        queue.cancel(job)
        queue._worker.join(0.1)
        while job.status is None:
            waiting.wait(0.05)
    finally:
        queue.close()
    assert job.state == "cancelled"
    assert job.status != 0
    assert {path.name for path in tmp_path.iterdir()} - {LOG} == before


def test_progress_is_read_from_the_lines_of_a_command() -> None:
    job = QueuedCommand("counterflex compensate part.ngc")
    job.take("compensating part.ngc: 42 %, about 3 s left")
    job.take("wrote out")
    job.take("error: part.ngc:3:1: no such word; got Q1")
    assert (job.fraction, job.what) == (0.42, "compensating part.ngc, about 3 s left")
    assert next(iter(job.lines)) == "wrote out"
    assert job.error == "part.ngc:3:1: no such word; got Q1"


def test_a_command_that_cannot_begin_does_not_stop_the_others(tmp_path: Path) -> None:
    queue = CommandQueue(tmp_path)
    try:
        jobs = [queue.add("counterflex path 'a\0b.ngc'"), queue.add("counterflex robots --no-such-option")]
        waiting = threading.Event()
        while not all(job.ended for job in jobs):
            waiting.wait(0.05)
    finally:
        queue.close()
    assert [job.state for job in jobs] == ["failed", "failed"]
    assert "cannot run" in jobs[0].error


def test_a_program_named_like_an_option_is_a_file() -> None:
    assert next_command("path", "--help.ngc", cell="cell.toml") == "counterflex path ./--help.ngc --cell cell.toml"


def test_names_that_no_page_can_show_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text("M30\n", encoding="ascii")
    (tmp_path / os.fsdecode(b"p\xff.ngc")).write_text("M30\n", encoding="ascii")
    assert Project(tmp_path).programs() == ["part.ngc"]


class Sent:
    """A file that a browser sends."""

    def __init__(self, name: str) -> None:
        self.name = name

    async def iterate(self) -> AsyncIterator[bytes]:
        """Yield the content."""
        yield b"new"


@pytest.mark.parametrize("name", ["part.ngc", "../part.ngc", "link.ngc", ".bashrc", "a\0b.ngc", ""])
def test_an_upload_replaces_nothing_and_leaves_the_folder_alone(tmp_path: Path, name: str) -> None:
    desk = pytest.importorskip("counterflex.app.studio.desk", exc_type=ImportError)
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "part.ngc").write_text("old", encoding="ascii")
    (folder / "link.ngc").symlink_to(tmp_path / "outside.ngc")
    shown: list[str] = []
    drop = object.__new__(desk.Drop)
    drop._desk = SimpleNamespace(project=Project(folder))
    drop.fault = SimpleNamespace(show=shown.append)
    event = SimpleNamespace(file=Sent(name), sender=SimpleNamespace(reset=lambda: None))
    asyncio.run(drop._take(event))
    assert shown[-1] != ""
    assert sorted(path.name for path in folder.iterdir()) == ["link.ngc", "part.ngc"]
    assert (folder / "part.ngc").read_text(encoding="ascii") == "old"
    assert not (tmp_path / "outside.ngc").exists()


def test_a_cell_file_that_changed_on_disk_is_not_overwritten(tmp_path: Path) -> None:
    cell_page = pytest.importorskip("counterflex.app.studio.cell_page", exc_type=ImportError)
    file = tmp_path / "cell.toml"
    file.write_text("a = 1\n", encoding="utf-8")
    page = object.__new__(cell_page.CellPage)
    page._desk = SimpleNamespace(cell="cell.toml", cell_file=file)
    page._saved, page._editor = "a = 1\n", SimpleNamespace(value="a = 2\n")
    assert page._write()
    assert file.read_text(encoding="utf-8") == page._saved == "a = 2\n"
    file.write_text("a = 3\n", encoding="utf-8")
    with pytest.raises(CounterflexError, match="changed since"):
        page._write()
    assert file.read_text(encoding="utf-8") == "a = 3\n"
    file.write_bytes(b"# \xfc\n")
    page._saved = cell_page._text(file)
    with pytest.raises(CounterflexError, match="changed since"):
        page._write()
    assert file.read_bytes() == b"# \xfc\n"


def test_a_card_is_marked_by_any_name() -> None:
    """A folder of results may be named as its maker likes: no property comes of it."""
    desk = pytest.importorskip("counterflex.app.studio.desk", exc_type=ImportError)
    from nicegui import Client, ui

    with Client(ui.page("")):
        box = desk.card("st-card", 'x" innerHTML="<img src=x>')
    assert dict(box.props) == {"data-test": 'x" innerHTML="<img src=x>'}
