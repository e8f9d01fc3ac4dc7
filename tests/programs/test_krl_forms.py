"""KRL in the form of RoboDK, KUKA|prc, the Robots plug-in, SprutCAM, inline forms and a milling cell's own jobs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.programs.test_krl_in_place import corrected, read_back

from counterflex.geometry import pose
from counterflex.integrations.kuka.language.in_place import write_krl_in_place
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.reader import job_files, read_krl_file
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

FOLDER = Path(__file__).parent / "krl_forms"
CELL = KrlCell(
    where="cell.toml", tool_number=1, base_number=1, tools=[1], tool_of_data={},
    T_flange_tcp=pose.make(None, np.array([0.0, 0.0, 0.2])), T_base_part=pose.make(None, np.array([1.35, -0.03, 1.0])),
    functions=MachineFunctions("krl", {3: [], 5: [], 6: []}),
)  # fmt: skip
LEVELS: list[list[tuple[float, float, float]]] = [
    [(0, 0, 14.5), (0, 0, 9.5), (0, 0, 8.5), (0, 0, 19.5 - depth), (50, 0, 19.5 - depth), (50, 0, 49.5)]
    for depth in (1.5, 3.0)
]
"""Of each pass of the milling cell's job: its base lies 0.5 mm below the part frame."""
ENDS_MM: dict[str, list[tuple[float, float, float]]] = {
    "robodk/rdk.src": [(0, 0, 50), (0, 0, 10), (50, 0, 10), (50, 20, 10)],
    "kuka_prc/prc.src": [(0, 0, 50), (0, 0, 10), (50, 0, 10)],
    "robots_plug-in/rob_KR.SRC": [(0, 0, 50), (0, 0, 10), (50, 0, 10), (50, 0, 10)],
    "sprutcam/sp.src": [(0, 0, 50), (0, 0, 10), (50, 0, 10), (50, 5, 10)],
    "inline_forms/inl.src": [(0, 0, 50), (0, 0, 10), (50, 0, 10)],
    "milling_cell/job.src": [(0, 0, 59.5), *LEVELS[0], *LEVELS[1], (50, 0, 49.5)],
}
FEEDS = {
    "robodk/rdk.src": {0.02}, "kuka_prc/prc.src": {0.25}, "robots_plug-in/rob_KR.SRC": {0.025},
    "sprutcam/sp.src": {0.02}, "inline_forms/inl.src": {0.02}, "milling_cell/job.src": {0.1, 0.02},
}  # fmt: skip


@pytest.mark.parametrize("cell", [None, CELL], ids=["no cell", "cell"])
@pytest.mark.parametrize("name", ENDS_MM)
def test_forms_of_posts_and_cells_are_read(name: str, cell: KrlCell | None) -> None:
    made = read_krl_file(FOLDER / name, cell=cell)
    np.testing.assert_allclose([motion.p_end * 1e3 for motion in made.motions], ENDS_MM[name], atol=1e-9)
    assert {motion.feed_m_s for motion in made.motions if motion.feed_m_s} == FEEDS[name]
    used = {file.name for file in job_files(FOLDER / name)} | {made.name}
    assert used == {file.name for file in (FOLDER / name).parent.iterdir()} == set(made.files)


@pytest.mark.parametrize("name", [name for name in ENDS_MM if "milling" not in name])
def test_forms_are_compensated_in_place(name: str) -> None:
    """The job of the milling cell repeats its lines, for each pass of which a target of its own is needed."""
    made = read_krl_file(FOLDER / name, cell=CELL)
    compensated = corrected(made, 1e-4, 4.0)
    text = write_krl_in_place(made, compensated, cycle_s=1e-4)
    assert text.moved_motions
    back = read_back(text, made)
    np.testing.assert_allclose(back.motions[-1].p_end, compensated.p_part_command[-1], atol=2e-7)


def test_parts_that_counterflex_writes_are_one_program(tmp_path: Path) -> None:
    """A path cut into files of three points: read as one program, compensated, and read again."""
    gcode = read_gcode("G21 G90 G17\nT1 M6\nM3 S9000\nG0 X0 Y0 Z20\n" + "".join(
        f"G1 X{x} Y{x % 3} Z-2 F600\n" for x in range(1, 11)
    ) + "M5\nM30\n")  # fmt: skip
    path = tool_path(gcode)
    Ts = pose.make(tool_orientation(path.axis_part, 0.0), path.p_part_tcp)
    settings = KrlSettings(name="part", start_axes_rad=[0.0] * 6, points_per_file=3)
    files = KrlWriter(gcode, path, Ts, settings, block_lines=CELL.functions.lines).text().files
    assert len([name for name in files if name.endswith(".src")]) > 3
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    made = read_krl_file(tmp_path / "part.src", cell=CELL)
    np.testing.assert_allclose(made.motions[-1].p_end, path.p_part_tcp[-1], atol=1e-7)
    assert {file.name for file in job_files(tmp_path / "part.src")} | {"part.src"} == set(files)
    compensated = corrected(made, 1e-4, 4.0)
    text = write_krl_in_place(made, compensated, cycle_s=1e-4)
    assert set(text.files) == set(files)
    np.testing.assert_allclose(read_back(text, made).motions[-1].p_end, compensated.p_part_command[-1], atol=2e-7)
