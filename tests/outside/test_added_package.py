"""A package beside counterflex adds one thing of each kind by one line, and every command uses it."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.extensions import extensions
from counterflex.app.identification.identify import run as identify
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.core.units import MM, N_PER_MM2, UM, UM_PER_KN
from counterflex.cutting.force_laws import FORCE_LAWS
from counterflex.cutting.material import load as material
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.writer import write_dataset
from counterflex.identify.recipes import RECIPES
from counterflex.protocols.force.sensors import Opening, link_values, opened
from counterflex.robot.model import catalog
from counterflex_lab.faults.rig import Rig

ROOT = Path(__file__).parents[2]
CELL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
LANGUAGES = (("languages", "poses"), ("languages", "melfa"))
RAKE = """law = "rake"
chip_min_um = 1.0
chip_max_um = 300.0
allow_extrapolation = true
source = "test"

[material.parameters]
kc11_n_mm2 = 780.0
mc = 0.23
kr_over_kc = 0.4
ka_over_kc = 0.1
rake_deg = {rake}
base_rake_deg = 6.0
"""


def cell_with(folder: Path, table: str) -> Path:
    """The small cell with another ``[material]``."""
    text = CELL.read_text(encoding="utf-8")
    begin = text.index("[material]\n") + len("[material]\n")
    after = re.compile(r"^\[", re.MULTILINE).search(text, begin)
    rest = text[after.start() :] if after else ""
    file = folder / "cell.toml"
    file.write_text(text[:begin] + table + "\n" + rest, encoding="utf-8")
    return file


@pytest.mark.long
@pytest.mark.usefixtures("example")
def test_the_force_law_is_its_closed_form_and_compensate_plans_with_it(tmp_path: Path) -> None:
    cell = read_cell(cell_with(tmp_path, RAKE.format(rake=16.0)))
    h = np.array([0.02, 0.1]) * MM
    factor = 1.0 - (16.0 - 6.0) / 100.0
    expected = factor * 780.0 * N_PER_MM2 * h * (h / MM) ** -0.23
    force = cell.force_law.edge_force(h)
    assert force[:, 0] == pytest.approx(expected, rel=1e-12)
    assert force[:, 1:] == pytest.approx(expected[:, None] * [0.4, 0.1], rel=1e-12)
    sharp, blunt = (
        compensate(
            ROOT / "examples" / "programs" / "groove.ngc", read_cell(cell_with(tmp_path, RAKE.format(rake=rake)))
        )
        for rake in (26.0, 6.0)
    )
    ratio = sharp.summary["prediction"]["peak_force_n"]["value"] / blunt.summary["prediction"]["peak_force_n"]["value"]
    assert ratio == pytest.approx(0.8, rel=1e-3)


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("mc = 0.23\n", ""), "needs mc"),
        (("mc = 0.23", "mc = 0.23\nmx = 1.0"), "no parameter mx"),
        (("rake_deg = 16.0", "rake_deg = 60.0"), "outside -30 to 30"),
        (('law = "rake"', 'law = "rake"\nkc11_n_mm2 = 780.0'), "remove kc11_n_mm2"),
        (('law = "rake"', 'law = "rakes"'), "Did you mean 'rake'"),
    ],
)
def test_what_the_law_does_not_read_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    with pytest.raises(FileFormatError, match=said):
        read_cell(cell_with(tmp_path, RAKE.format(rake=16.0).replace(*change)))


def nose_pushes(folder: Path, name: str, seed: int, count: int = 30) -> Path:
    """Pushes against a tool of 12 um/kN, a gauge of 1 um."""
    rng = np.random.default_rng(seed)
    f = 200.0 * rng.standard_normal((count, 3))
    d = 12.0 * UM_PER_KN * f + UM * rng.standard_normal((count, 3))
    return write_dataset(folder, name, "nose_pushes", {"f_tcp_base": f, "d_tcp_base": d}, {"d_tcp_base": UM})


@pytest.mark.usefixtures("example")
def test_the_recipe_finds_the_compliance_within_its_interval_and_writes_the_cell(tmp_path: Path) -> None:
    data, unseen = nose_pushes(tmp_path, "pushes", 1), nose_pushes(tmp_path, "unseen", 2)
    result = identify("nose", [data], CELL, tmp_path / "out", holdout=[unseen])
    assert result["headline"][0]["value"] == pytest.approx(1.596, rel=0.15)  # mean length of the gauge's noise, um
    assert result["headline"][0]["nominal"] > 3.0
    segment = read_cell(tmp_path / "out" / "cell.toml").end_effector.segments[-1]
    sigma = UM / (200.0 * np.sqrt(90.0))
    assert segment.compliance[:3] == pytest.approx(12.0 * UM_PER_KN, abs=4.0 * sigma)


class _AsciiDevice:
    """The sensor's side of the text protocol."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address = self._socket.getsockname()
        self.peer: tuple[str, int] | None = None
        self.spoil: Callable[[bytes], bytes] = lambda line: line

    def poll(self) -> None:
        try:
            word, peer = self._socket.recvfrom(64)
        except BlockingIOError:
            return
        self.peer = peer if word == b"GO" else self.peer

    def send(self, w_sensor: Float) -> None:
        if self.peer is not None:
            self._socket.sendto(self.spoil(("F " + " ".join(f"{v:.6f}" for v in w_sensor)).encode()), self.peer)

    def close(self) -> None:
        self._socket.close()


class _AsciiRig(Rig):
    def _instrument(self) -> tuple[Any, Any]:
        device = _AsciiDevice()
        host, port = device.address
        return device, opened("ascii", Opening(host, port, values=link_values("ascii", {})))


@pytest.mark.usefixtures("example")
def test_the_force_sensor_closes_the_loop_as_the_net_ft_does() -> None:
    ends = []
    for rig_of in (Rig, _AsciiRig):
        with rig_of(force=lambda _: np.array([0.0, 200.0, 0.0]), holds_feed=False) as rig:
            rig.activate().run(400)
            assert rig.seen.path()[-1] == "active"
            ends.append(np.mean(rig.seen.correction_m[-100:], axis=0))
    assert np.linalg.norm(ends[0]) > 1e-4
    assert ends[1] == pytest.approx(ends[0], abs=0.02 * float(np.linalg.norm(ends[0])))


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("line", [b"F 1 2 3", b"F a b c d e f", b"F nan 0 0 0 0 0", b"\xff" * 200])
def test_lines_that_are_no_samples_are_no_force_and_the_loop_holds(line: bytes) -> None:
    with _AsciiRig(force=lambda _: np.array([0.0, 200.0, 0.0]), holds_feed=False) as rig:
        rig.activate().run(200)
        before = rig.seen.correction_m[-1]
        rig.sensor.spoil = lambda _: line
        rig.run(40)
        assert rig.seen.path()[-1].startswith("hold (force")
        assert np.linalg.norm(rig.seen.correction_m[-1] - before) < rig.step_limit_m


@pytest.mark.usefixtures("example")
def test_the_language_writes_every_point_and_all_stands_beside_it(tmp_path: Path) -> None:
    found = compensate(ROOT / "examples" / "programs" / "groove.ngc", read_cell(CELL), language="poses", predict=False)
    (name, text), *more = found.files.items()
    assert (name, more) == ("groove.poses", [])
    table = np.array([line.split() for line in text.splitlines()], dtype=np.float64)
    wanted = found.plan.path.p_part_tcp + found.plan.correction_part
    assert table[:, :3] * MM == pytest.approx(wanted, abs=1e-7)


@pytest.mark.usefixtures("example")
def test_robot_and_material_are_found_by_name() -> None:
    assert catalog.load("example_arm").name == "example_arm"
    assert "example_arm" in catalog.names()
    assert material("example-alloy").cutting[0] == 800.0 * N_PER_MM2


@pytest.mark.long
def test_the_command_lists_what_the_package_brings(installed: Path) -> None:
    path = os.pathsep.join([str(installed), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "counterflex", "extensions", "--json"],
        capture_output=True, text=True, check=True, timeout=60, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    added = {
        (row["group"], row["name"]) for row in json.loads(done.stdout) if row["package"] == "counterflex-example 1.0"
    }
    brought = {
        "force_laws": "rake", "force_sensors": "ascii", "recipes": "nose", "controllers": "mitsubishi",
        "robot_links": "melfa", "robots": "example_arm", "materials": "example",
    }  # fmt: skip
    assert added == {(f"counterflex.{group}", name) for group, name in (*brought.items(), *LANGUAGES)}


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import no_such_module", "ModuleNotFoundError"),
        ("raise SystemExit(3)", "SystemExit"),
        ("LAW = 3", "wrong type; got int; expected an instance of counterflex.cutting.force_laws.LawKind"),
        ("", "has no attribute 'LAW'"),
    ],
)
def test_a_broken_package_is_named_and_stops_nothing_else(
    package: Callable[[str, str, str], None], source: str, said: str
) -> None:
    package("counterflex.force_laws", "odd = added:LAW", source)
    with pytest.raises(InputError, match=said) as fault:
        FORCE_LAWS["odd"]
    assert "added 1.0: entry point odd = added:LAW of counterflex.force_laws" in str(fault.value)
    assert read_cell(CELL).force_law.terms().shape[1] == 4
    assert [item.name for item in extensions() if item.fault] == ["odd"]


def test_two_packages_with_one_name_are_both_named(package: Callable[[str, str, str], None]) -> None:
    package("counterflex.recipes", "stiffness = added:RECIPE", "")
    with pytest.raises(InputError, match=r"'stiffness' of counterflex and of added 1\.0"):
        RECIPES["stiffness"]


LAW = """
from counterflex.cutting.force_laws import LawKind
class Law:
    h_min_m, h_max_m, source, status = 1e-6, 3e-4, "test", "test"
    def terms(self):
        return {terms}
LAW = LawKind("odd", lambda values, valid: Law())
"""


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ("[[2.0, 1.0, 1.0, 1.0]]", "no sum of powers"),
        ("[[1.0, float('nan'), 1.0, 1.0]]", "no sum of powers"),
        ("[1.0]", "no sum of powers"),
        ("[[1.0, -1.0, 0.0, 0.0]]", "along its own motion"),
        ("1 / 0", "ZeroDivisionError"),
    ],
)
def test_a_law_that_is_none_is_refused(
    package: Callable[[str, str, str], None], tmp_path: Path, terms: str, said: str
) -> None:
    package("counterflex.force_laws", "odd = added:LAW", LAW.format(terms=terms))
    with pytest.raises(FileFormatError, match=said):
        read_cell(cell_with(tmp_path, 'law = "odd"\n'))


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ("{'../part.txt': ''}, {}", "must not"),
        ("{'plan.parquet': ''}, {}", "must not"),
        ("1 / 0", "ZeroDivisionError"),
        ("3", "TypeError"),
    ],
)
def test_a_writer_names_its_own_files_only(package: Callable[[str, str, str], None], result: str, said: str) -> None:
    source = f"""
from counterflex.programs.language import Language
WAY = Language(title="odd", write=lambda order: ({result}))
"""
    package("counterflex.languages", "odd = added:WAY", source)
    program = ROOT / "examples" / "programs" / "groove.ngc"
    with pytest.raises(OutputError, match=said):
        compensate(program, read_cell(CELL), language="odd", predict=False)


@pytest.mark.parametrize("file", ["ascii_sensor.py", "nose.py", "rake.py"])
def test_the_page_for_newcomers_quotes_this_package(file: str) -> None:
    page = (ROOT / "docs" / "extend.md").read_text(encoding="utf-8")
    code = (Path(__file__).parent / "counterflex_example" / file).read_text(encoding="utf-8")
    assert f"```python\n{code}```" in page
    registered = (Path(__file__).parent / "pyproject.toml").read_text(encoding="utf-8")
    for line in re.findall(r'^\w+ = "counterflex_example\..*"$', page, re.MULTILINE):
        assert line in registered
