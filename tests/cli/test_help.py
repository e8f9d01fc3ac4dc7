"""Help: every command explains itself with an example that runs, quickly and without the heavy libraries."""

from __future__ import annotations

import itertools
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import typer

from counterflex.app import examples
from counterflex.app.benchmark_part.part import program_sha256
from counterflex.app.run.loop import online_loop
from counterflex.cli.main import whole
from counterflex.evaluate.loop_timing import LoopSamples
from counterflex.files.benchmark_result import MEASURED, BenchmarkResult, FeatureResult, write_benchmark_result
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.writer import write_dataset
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.protocols.system.machine import Machine
from counterflex.protocols.system.realtime import Granted
from counterflex.runtime import record_ring as record
from counterflex.runtime.cycle_inputs import CycleInputs
from production_log import cut_of, rows_of, write_rows

RESULT = json.dumps(
    {
        "format": "counterflex-identification", "version": 1, "recipe": "stiffness", "title": "Compliances",
        "date": "2026-03-14 08:30:00", "cell": "KR 300", "versions": {"counterflex": "0.1.0"},
        "data": [{"name": "pulls", "sha256": "ab"}],
        "fits": {"arm": {"parameters": [
            {"name": "axis1.rz", "label": "", "unit": "urad/kNm", "value": 3.0, "sigma": 0.1, "low": 2.8, "high": 3.2}
        ]}},
    }
)  # fmt: skip
HEAVY = ("rich", "numpy", "numba", "scipy", "polars", "mujoco", "plotly", "pydantic", "trimesh", "jinja2")


def _commands(command: Any, path: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """Every command below a command, by the words that call it."""
    below = getattr(command, "commands", {})
    found = {} if below else {path: command}
    for name, item in below.items():
        found |= _commands(item, (*path, name))
    return found


COMMANDS = _commands(typer.main.get_command(whole()))
EXAMPLES = [
    example
    for command in COMMANDS.values()
    for example in re.findall(r"`counterflex ([^`]+)`", " ".join((command.help or "").split()))
]
LIVE = (
    "run",
    "twin cell",
    "twin rsi",
    "twin netft",
    "twin wrench",
    "twin tracker",
    "twin ads",
    "twin egm",
    "twin proxy",
    "twin scenarios",
    "tracker bridge",
    "operator",
    "panel",
    "studio",
    "opcua",
    "ads",
)
"""Commands that wait for each other or for a device: tests of their own run them over sockets."""
JOBS = ("soak", "faults", "reproduce")
"""Commands that run a loop over sockets for minutes or hours: tests of their own run small parts of them."""
ALONE = [example for example in EXAMPLES if not example.startswith(LIVE + JOBS)]


SHORTER = {
    "campaign": ["--workers", "1"],
    "demo": ["--workers", "1", "--seeds", "1"],
    "prove": ["--workers", "1", "--seeds", "1", "--no-exact"],
    "holder design": ["--bricks", "1"],
    "plan map": ["--points", "3"],
    "plan placement": ["--candidates", "64"],
}
"""Options behind examples that would take long: whether one runs shows with the last of two values too."""


PLUNGED = "G21 G17 G90 G94\nM6 T1\nM3 S13000\nG0 X10 Y15\nG0 Z22\nG1 Z17 F600\nX50 F1500\nG0 Z40\nM30\n"
"""A slot that begins with a plunge: something to soften."""


SLOT = "G21 G17 G90 G94\nM6 T1\nM3 S13000\nG0 X-20 Y15\nG0 Z22\nG1 Z17 F600\nX60 F1500\nG0 Z40\nM30\n"
"""A slot through the whole blank, with air before and behind it."""


def test_all_commands_are_known() -> None:
    assert len(COMMANDS) >= 11
    assert {("compensate",), ("cell", "check"), ("pose",), ("demo",)} <= set(COMMANDS)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help(counterflex: Any, words: tuple[str, ...]) -> None:
    ended = counterflex(*words, "--help")
    assert ended.status == 0
    assert ended.err == ""
    assert "Usage: counterflex " + " ".join(words) in ended.out
    assert any(example.startswith(" ".join(words)) for example in EXAMPLES)


def test_help_of_the_groups(counterflex: Any) -> None:
    assert "compensate" in counterflex("--help").out
    assert "example" in counterflex("cell", "--help").out
    assert counterflex("--version").out.startswith("counterflex ")


def scan(folder: Path) -> None:
    """Points all over the part that the small program makes."""
    block = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [40.0, 30.0, 20.0]])
    slot = trimesh.creation.box(bounds=[[-1.0, 7.0, 17.0], [10.0, 23.0, 30.0]])
    end = trimesh.creation.cylinder(8.0, 20.0, sections=128)
    end.apply_translation([10.0, 15.0, 27.0])
    points, _ = trimesh.sample.sample_surface(trimesh.boolean.difference([block, slot, end]), 20_000, seed=1)
    trimesh.PointCloud(points).export(folder / "part.ply")


@pytest.mark.by_turn
@pytest.mark.parametrize("example", ALONE)
def test_example(folder: Path, counterflex: Any, machined: Any, monkeypatch: pytest.MonkeyPatch, example: str) -> None:
    """Every example of the help, on the small cell and program, in a folder where what it reads is there."""
    small = {"cell.toml": (folder / "cell.toml").read_text(encoding="utf-8")}
    small["part.ngc"] = (folder / "part.ngc").read_text(encoding="utf-8")
    rsi = examples.text("rsi.xml")
    shipped = examples.text
    monkeypatch.setattr(examples, "text", lambda name: small.get(name) or shipped(name))
    words = shlex.split(example)
    if words[0] == "rsi":
        (folder / "rsi.xml").write_text(rsi, encoding="utf-8")
        (folder / "cell.toml").write_text(small["cell.toml"] + "\n[online]\n", encoding="utf-8")
    if words[0] == "holder":
        shutil.copy(Path(__file__).parents[2] / "examples" / "holders" / "bridged.toml", folder / "holder.toml")
    if words[0] == "egm":
        rapid(folder, counterflex)
    if words[:2] == ["cell", "example"]:
        (folder / "cell.toml").unlink()
        (folder / "part.ngc").unlink()
        (folder / "rsi.xml").unlink(missing_ok=True)
    if words[:2] == ["cell", "import"]:
        (folder / "cell.toml").unlink()
        shutil.copy(Path(__file__).parents[2] / "examples" / "controller" / "config.dat", folder / "$config.dat")
    if words[0] == "dcc":
        shutil.copy(Path(__file__).parents[2] / "examples" / "certificates" / "force_sensor.xml", folder / "sensor.xml")
        (folder / "cell.toml").write_text(small["cell.toml"] + '\n[sensor]\nsegment = "sensor"\n', encoding="utf-8")
        (folder / "result.json").write_text(RESULT, encoding="utf-8")
    if words[0] == "simulate":
        assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out").status == 0
        shutil.copy(machined.folder / "truth.toml", folder)
    if words[0] == "diff":
        assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-report").status == 0
    if words[0] in ("predict", "reveal"):
        assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "plan", "--no-report").status == 0
    if words[0] == "reveal":
        assert counterflex("predict", "plan", "--out", "groove.json").status == 0
        proof = ("prove", "part.ngc", "--cell", "cell.toml", "--out", "proof", "--workers", "1", "--no-exact")
        assert counterflex(*proof).status == 0
    if words[0] == "correct":
        assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-report").status == 0
        shutil.copytree(machined.folder / "run", folder / "part1")
    if words[0] == "production":
        (folder / "part.ngc").write_text(SLOT, encoding="utf-8")
        assert counterflex("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-report").status == 0
        plan, cell = Path(shutil.move(folder / "out" / "plan.parquet", folder)), folder / "cell.toml"
        write_rows(folder / "run-log", rows_of(plan, cut_of(cell, plan), read_cell(cell).force_law.terms()), plan, cell)
    if words[0] in ("evaluate", "mesh", "report"):
        shutil.copytree(machined.folder / "run", folder / "run-before")
        shutil.copytree(machined.folder / "run", folder / "run-after")
    if words[0] == "inspect":
        scan(folder)
    if words[0] == "benchmark-part":
        shipped_files = Path(__file__).parents[2] / "examples"
        shutil.copy(shipped_files / "cells" / "kr300_d16_small.toml", folder / "cell.toml")
        shutil.copy(shipped_files / "scans" / "benchmark_part.ply", folder / "cf1.ply")
        for name in ("before", "after"):
            write_benchmark_result(folder / name / "result.json", made_result(name))
    if words[0] == "firstcut":
        shipped_files = Path(__file__).parents[2] / "examples"
        shutil.copy(shipped_files / "cells" / "kr300_d16_small.toml", folder / "cell.toml")
        assert counterflex(words[0], "--propose", "1500,13000", "--cell", "cell.toml", "--out", "coupon").status == 0
        table = folder / "coupon" / "measure.csv"
        header, *rows = table.read_text(encoding="utf-8").splitlines()
        table.write_text("\n".join([header, *(row + row.split(",")[6] for row in rows)]), encoding="utf-8")
    if words[0] == "quote":
        (folder / "tolerances.csv").write_text("feature,quantity,tolerance_mm\nslot 1,width,0.2\n", encoding="utf-8")
    if words[0] == "thermal":
        shutil.copy(Path(__file__).parents[2] / "examples" / "touches.csv", folder)
    if "axis.csv" in words:
        shutil.copy(Path(__file__).parents[2] / "examples" / "robot_tests" / "axis.csv", folder)
    if words[0] == "doctor":
        monkeypatch.setattr("counterflex.app.doctor.probe", good_machine)
        monkeypatch.setattr("counterflex.app.doctor.machine_file", lambda: folder / "machine.json")
    if words[0] == "log":
        run_log(folder)
        for other in ("monday", "tuesday") if words[1] == "compare" else ():
            shutil.copytree(folder / "log", folder / other)
    if words[0] in ("twin", "campaign"):
        shutil.copy(machined.folder / "truth.toml", folder)
    if words[0] == "twin":
        proposal = ("identify", "tracker-frame", "--propose", "12", "--cell", "cell.toml", "--out", "proposal")
        assert counterflex(*proposal).status == 0
    if words[0] in ("identify", "dataset"):
        fiducials(folder)
    if words[0] in ("iso9283", "iso230", "twin"):
        tracked(folder)
    if words[:2] == ["identify", "history"]:
        found = ("identify", "tracker-frame", "points.toml", "--cell", "cell.toml", "--out", "out")
        assert counterflex(*found).status == 0
    for command, shorter in SHORTER.items():
        words += shorter if example.startswith(command) else []
    if words[:2] == ["plan", "entry"]:
        (folder / "part.ngc").write_text(PLUNGED, encoding="utf-8")
    ended = counterflex(*words)
    assert ended.status == 0, ended.err
    assert ended.err == ""
    assert ended.out
    if "--out" in words:
        assert (folder / words[words.index("--out") + 1]).exists()


def made_result(laboratory: str) -> BenchmarkResult:
    """A benchmark part without any deviation."""
    rows = [
        FeatureResult(
            feature=row.feature, quantity=row.quantity, nominal_mm=row.nominal_mm, tolerance_mm=row.tolerance_mm,
            worst_mm=row.nominal_mm, mean_mm=row.nominal_mm, uncertainty_um=10.0, within=True,
        )
        for row in MEASURED
    ]  # fmt: skip
    return BenchmarkResult(
        laboratory=laboratory, robot="KR 300", material="EN AW-2017", method="identified", scan="cf1.ply",
        program_sha256=program_sha256(), scan_points=30_000, scan_noise_um=10.0, placed_by=("x-", "y-", "top"),
        residual_um=5.0, surface_p997_mm=0.03, features=tuple(rows), counterflex="0.1.0",
    )  # fmt: skip


def rapid(folder: Path, counterflex: Any) -> None:
    """A cell that corrects by EGM, ``plan/part.mod`` as compensate writes it, and ``part.mod`` with EGM around it."""
    with (folder / "cell.toml").open("a", encoding="utf-8") as stream:
        stream.write('\n[online]\nforce = "measured"\nperiod_ms = 24\n')
    filtered = ("compensate", "part.ngc", "--cell", "cell.toml", "--as", "rapid", "--no-predict", "--out", "plan")
    assert counterflex(*filtered).status == 0
    made = counterflex("egm", "make", "--cell", "cell.toml", "--program", "plan/part.mod", "--out", "made")
    assert made.status == 0, made.err
    shutil.copy(folder / "made" / "part.mod", folder)


def run_log(folder: Path) -> None:
    """A run log ``log`` of ten cycles of the cell's loop."""
    with (folder / "cell.toml").open("a", encoding="utf-8") as stream:
        stream.write('\n[online]\nforce = "measured"\nalong_feed = true\n')
    loop = online_loop(read_cell(folder / "cell.toml"), None, compensated=False)
    rows = np.zeros((10, record.WIDTH))
    for row in rows:
        loop.feed(CycleInputs(T_part_tcp=np.eye(4), q=np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])))
        loop.run()
        row[record.GIVEN : record.MONITOR] = np.r_[*loop.inputs, *loop.answers]
        row[record.MONITOR :] = np.r_[*loop.monitor.columns[1:], loop.cycle]
    log = RunLogWriter(folder / "log", {})
    log.add(rows)
    log.close()


def tracked(folder: Path) -> None:
    """Programs ``square.ngc`` and ``circle.ngc``, and logs of a tracker along them: two cycles, two turns."""
    head, end = "G17 G21 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\nG0 X10 Y15\n", "G0 Z70\nM30\n"
    (folder / "square.ngc").write_text(head + "G1 X30 F3000\nG1 Y30\nG1 X10\nG1 Y15\n" + end, encoding="utf-8")
    (folder / "circle.ngc").write_text(head + "G3 X10 Y15 I10 J0 F3000\n" + end, encoding="utf-8")
    corners = np.array(
        [(10, 15, 70), (10, 15, 60), (30, 15, 60), (30, 30, 60), (10, 30, 60), (10, 15, 60), (10, 15, 70)]
    )
    way = np.concatenate([np.linspace(a, b, 200, endpoint=False) for a, b in itertools.pairwise(corners)] * 2)
    angle = np.pi + np.linspace(0.0, 15.0, 3000)
    ring = np.column_stack([20.0 + 10.0 * np.cos(angle), 15.0 + 10.0 * np.sin(angle), np.full(3000, 60.0)])
    for name, p in (("log.csv", way), ("ring.csv", ring)):
        rows = np.column_stack([0.001 * np.arange(len(p)), p])
        np.savetxt(folder / name, rows, "%.6f", ",", header="time_s,x_mm,y_mm,z_mm", comments="")


def good_machine(*_: object) -> tuple[LoopSamples, Granted, Machine]:
    """What the doctor would measure on a good machine."""
    n = 2500
    samples = LoopSamples(
        4e-3, np.full(n, 4e-5), np.full(n, 1e-5), np.full(n, 5e-5), np.ones(9) * 1e-5, np.ones(2) * 1e-3
    )
    return samples, Granted(True, True, True, ()), Machine(4, ("performance",), "tsc", False, None)


def fiducials(folder: Path) -> None:
    """A dataset ``points.toml``: six fiducials, known in the base and measured by a tracker 4 m away."""
    p = np.array(
        [[1.0, 0.0, 0.2], [0.0, 1.2, 0.9], [-1.0, 0.3, 0.1], [0.2, -1.1, 1.5], [1.3, 1.0, 1.8], [-0.9, -1.0, 0.4]]
    )
    seen = p - np.array([4.5, 0.5, 1.2]) + 1e-5 * np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 1]] * 2)
    channels = {"p_base_fiducial": p, "p_tracker_fiducial": seen}
    write_dataset(folder, "points", "fiducials", channels, dict.fromkeys(channels, 2e-5))


def test_a_request_of_the_operator_waits_for_no_command_parser(tmp_path: Path) -> None:
    """A stop is to start in a fraction of a second on a busy computer too."""
    program = (
        "import sys; sys.argv = ['counterflex', 'operator', 'stop', 'nolog']\n"
        "from counterflex.cli.start import run\n"
        "try:\n    run()\nexcept SystemExit as end:\n    assert end.code == 2\n"
        f"print('LOADED', *[name for name in (*{HEAVY!r}, 'typer') if name in sys.modules])\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["LOADED"]
    assert "no run goes on there" in ended.stderr


def test_help_reads_the_options_of_no_command(monkeypatch: pytest.MonkeyPatch, counterflex: Any) -> None:
    """Of some 50 commands they took half of the time."""
    read: list[Any] = []
    genuine = vars(typer.main)["get_params_from_function"]

    def watched(found: Any) -> Any:
        read.append(found)
        return genuine(found)

    monkeypatch.setattr(typer.main, "get_params_from_function", watched)
    assert "compensate" in counterflex("--help").out
    assert not {info.callback for info in whole().registered_commands} & set(read)
    assert "--scenario" in counterflex("compensate", "--help").out


def test_examples_can_be_copied_in_one_piece(counterflex: Any) -> None:
    for words, command in COMMANDS.items():
        for example in re.findall(r"Example: `counterflex ([^`]+)`", " ".join((command.help or "").split())):
            assert example in counterflex(*words, "--help").out


def test_what_a_command_has_loaded_is_not_collected_at_its_end() -> None:
    """Going through the objects of all libraries once more took a third of a short command."""
    program = (
        "import atexit, gc, sys; atexit.register(lambda: print('FROZEN', gc.get_freeze_count()))\n"
        "sys.argv = ['counterflex', 'compensate', '--help']\n"
        "from counterflex.cli.start import run\n"
        "run()\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    word, count = ended.stdout.splitlines()[-1].split()
    assert word == "FROZEN"
    assert int(count) > 10_000


@pytest.mark.parametrize("word", ["--help", "--version"])
def test_help_and_version_load_no_heavy_library(word: str) -> None:
    program = (
        f"import sys; sys.argv = ['counterflex', '{word}']\n"
        "from counterflex.cli.start import run\n"
        "try:\n    run()\nexcept SystemExit as end:\n    assert end.code == 0\n"
        f"print('LOADED', *[name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines()[-1].split() == ["LOADED"]


def test_a_pose_of_a_catalogue_robot_loads_no_cell() -> None:
    """Reading cells brings plan, loop and protocols with it: half a second more than the question takes."""
    program = (
        "import sys; sys.argv = ['counterflex', 'pose', 'kuka_kr300_r2500_ultra', '--joints-deg', '0,-90,90,0,0,0']\n"
        "from counterflex.cli.start import run\n"
        "try:\n    run()\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "rooms = ('counterflex.files.cell', 'counterflex.plan')\n"
        "print('LOADED', *[name for name in sys.modules if name.startswith(rooms)])\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines()[-1].split() == ["LOADED"]
