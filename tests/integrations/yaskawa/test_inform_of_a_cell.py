"""INFORM with a cell file: converted and read back, compensated anew, axes and types of posture of the robot."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from counterflex.app import conversion
from counterflex.app.robot_programs import robot_cell
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose
from counterflex.integrations.yaskawa.axes import AXES
from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.integrations.yaskawa.language.job import configurations
from counterflex.integrations.yaskawa.language.program import rconf
from counterflex.integrations.yaskawa.language.reader import read_inform, read_inform_file
from counterflex.programs.language import LANGUAGES, at_prompt
from counterflex.programs.reading import dialect_of, read_program_file
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse_seeds import branch_of
from counterflex.robot.model.controller_axes import from_geometry
from inform_jobs import job, points

EXAMPLES = Path(__file__).parents[3] / "examples"
CELL = EXAMPLES / "cells" / "kr300_d16_small.toml"
ARCS = """G21 G90 G17
T1 M6
G43 H1
M3 S9000
G0 X0 Y0 Z50
G1 Z40 F600
G2 X20 Y0 I10 J0
G3 X40 Y0 I10 J0
G4 P0.25
G3 X40 Y0 I0 J7.5
G1 X45.1234 Y3.3333 F1000
M5
M30
"""


def test_inform_is_a_language_like_the_others() -> None:
    assert at_prompt("convert")["inform"] == at_prompt("write")["inform"] == "inform"
    assert LANGUAGES["inform"].robot
    assert dialect_of("MILL.JBI") == "inform"


def test_arcs_and_dwells_travel_there_and_back(tmp_path: Path) -> None:
    """A half circle, another one at its end, a dwell, a whole one: arcs of MOVC, joined at FPT; then G-code again."""
    source = tmp_path / "arcs.ngc"
    source.write_text(ARCS)
    found = conversion.run(source, CELL, tmp_path / "there", "inform")
    assert found["read_back_um"] <= 1.0
    text = (tmp_path / "there" / "arcs.JBI").read_text()
    assert text.count("MOVC") == 1 + 2 + 2 + 4
    assert "V=16.6667" in text
    program = read_inform_file(tmp_path / "there" / "arcs.JBI")
    assert [m.kind for m in program.motions] == ["rapid", "feed", "arc", "arc", "dwell", "arc", "arc", "feed"]
    back = conversion.run(tmp_path / "there" / "arcs.JBI", CELL, tmp_path / "back", "gcode")
    assert back["read_back_um"] <= 1.0
    again = read_program_file(tmp_path / "back" / "arcs.ngc")
    np.testing.assert_allclose(again.motions[-1].p_end / MM, [45.123, 3.333, 40.0], atol=1e-9)
    assert sum(abs(m.turn_rad) for m in again.motions) == pytest.approx(4.0 * np.pi, abs=1e-3)


def test_a_long_job_is_cut_into_jobs_that_are_called(tmp_path: Path) -> None:
    source = tmp_path / "arcs.ngc"
    source.write_text(ARCS)
    found = conversion.run(source, CELL, tmp_path / "there", "inform", points_per_file=3)
    assert len(found["files"]) > 2
    main = (tmp_path / "there" / found["files"][0]).read_text()
    assert re.findall(r"CALL JOB:(\w+)", main) == [Path(name).stem.upper() for name in found["files"][1:]]


def gp25(axes_deg: np.ndarray) -> np.ndarray:
    """(4, 4) m, flange of a GP25 in the base by the URDF of ROS-Industrial: origins and axes of its joints."""
    T = np.eye(4)
    for p, axis, angle in zip(
        [(0, 0, 0.505), (0.15, 0, 0), (0, 0, 0.76), (0, 0, 0.2), (0.795, 0, 0), (0, 0, 0)],
        [(0, 0, 1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0), (-1, 0, 0)], axes_deg, strict=True,
    ):  # fmt: skip
        R = Rotation.from_rotvec(np.array(axis) * angle * DEG).as_matrix()
        T = T @ pose.make(R, np.array(p, dtype=np.float64))
    return T @ pose.make(Rotation.from_euler("xyz", [np.pi, -0.5 * np.pi, 0.0]).as_matrix(), np.array([0.1, 0.0, 0.0]))


GEOMETRY = """[robot.geometry]
a1_mm = 150
a2_mm = -200
c1_mm = 505
c2_mm = 760
c3_mm = 795
c4_mm = 100
offsets_deg = [0, 0, -90, 0, 0, -180]
signs = [1, 1, -1, -1, -1, -1]
limits_deg = [[-180, 180], [-105, 155], [-160, 160], [-200, 200], [-155, 150], [-455, 455]]

[robot.controller_axes]
maker = "yaskawa"
pulses_per_deg = [1000, 1000, 1000, 500, 500, 250]
"""


def gp25_cell(tmp_path: Path) -> Path:
    """The example cell of an own geometry with the lengths of a GP25."""
    text = (EXAMPLES / "cells" / "own_geometry.toml").read_text()
    begin = text.index("[robot.geometry]")
    end = text.index("[[robot.elastic", begin)
    file = tmp_path / "gp25.toml"
    file.write_text(f"{text[:begin]}{GEOMETRY}\n{text[end:]}")
    return file


@pytest.mark.parametrize("axes_deg", [(0, 0, 0, 0, 0, 0), (20, 30, -15, 40, -50, 60), (-100, -40, 70, -120, 90, 200)])
def test_axes_of_the_controller_are_those_of_the_urdf(tmp_path: Path, axes_deg: tuple[float, ...]) -> None:
    """S L U R B T as the pendant shows them, by the closed form and by the joints of another description."""
    cell = read_cell(gp25_cell(tmp_path))
    axes, shown = cell.nominal_robot.axes, np.array(axes_deg, dtype=np.float64)
    assert axes.maker == "yaskawa"
    assert axes.world_m == pytest.approx(0.505)
    q = axes.model(shown * DEG)
    T_base_flange = forward(cell.controller_chain, q) @ pose.inverse(cell.controller_chain.T_flange_tcp)
    np.testing.assert_allclose(T_base_flange, gp25(shown), atol=1e-9)
    opw = cell.nominal_robot.opw
    assert opw is not None
    again = from_geometry("yaskawa", opw.signs, opw.offsets_rad, opw.c1_m)
    np.testing.assert_allclose(again.shown(q) / DEG, shown, atol=1e-9)


def test_pulses_of_the_cell_file_are_a_place_of_the_tip(tmp_path: Path) -> None:
    cell = read_cell(gp25_cell(tmp_path))
    held = robot_cell(cell, "inform")
    assert isinstance(held, InformCell)
    shown = np.array([5.0, 20.0, -10.0, 0.0, -40.0, 30.0])
    pulses = shown * np.array(held.pulses_per_deg)
    header = ("///TOOL 1", "///POSTYPE PULSE", "///PULSE")
    entry = f"C00000={','.join(f'{value:.0f}' for value in pulses)}"
    made = read_inform(job("MOVL C00000 V=5.0", entries=[entry], header=header), cell=held)
    T = forward(cell.controller_chain, cell.nominal_robot.axes.model(shown * DEG))
    np.testing.assert_allclose(made.motions[0].p_end, (pose.inverse(cell.T_base_part) @ T)[:3, 3], atol=1e-9)


def test_rconf_follows_the_robot_and_is_read_as_the_same_posture(tmp_path: Path) -> None:
    """Flags of poses made by known axes; front and elbow agree with the posture that the reader finds in them."""
    cell = read_cell(gp25_cell(tmp_path))
    axes = cell.nominal_robot.axes
    for shown, expected in {
        (0, 10, 0, 0, -60, 0): "0,0,0,0,0,0",
        (0, 10, 0, 120, -60, 0): "1,0,0,0,0,0",
        (0, 10, 0, -190, -60, 270): "1,0,0,1,1,0",
    }.items():
        q = axes.model(np.array(shown, dtype=np.float64) * DEG)
        assert rconf(branch_of(cell.controller_chain, q), (np.array(shown) * DEG).tolist()) == expected
        T_part_tcp = pose.inverse(cell.T_base_part) @ forward(cell.controller_chain, q)
        assert configurations(cell, q)(T_part_tcp) == expected
    header = ("///USER 1", "///TOOL 1", "///POSTYPE USER", "///RECTAN", "///RCONF 1,1,0,0,0,0")
    made = read_inform(job("MOVL C00000 V=5.0", entries=points((0, 0, 0)), header=header))
    posture, words = made.postures()[0]
    assert words == "RCONF 1,1,0"
    assert posture.agrees("front down flip")
    assert not posture.agrees("front up noflip")
    assert not posture.agrees("back up noflip")


def test_a_robot_that_cannot_reach_a_point_has_no_rconf(tmp_path: Path) -> None:
    source = tmp_path / "far.ngc"
    source.write_text("G21 G90\nT1 M6\nG43 H1\nG0 X0 Y0 Z50\nG1 X9000 F600\nM30\n")
    with pytest.raises(CounterflexError, match="reach"):
        conversion.run(source, CELL, tmp_path / "there", "inform")
    assert not (tmp_path / "there").exists()


def test_pulses_need_a_plausible_ratio(tmp_path: Path) -> None:
    file = gp25_cell(tmp_path)
    file.write_text(file.read_text().replace("[1000, 1000, 1000, 500, 500, 250]", "[0, 1000, 1000, 500, 500, 250]"))
    with pytest.raises((InputError, CounterflexError), match="pulses_per_deg"):
        read_cell(file)


def test_the_maker_states_its_convention() -> None:
    assert (AXES.language, AXES.world, AXES.axis_3) == ("inform", "axis 2", "upper_arm")
    R = Rotation.from_euler("xyz", [10.0, -20.0, 30.0], degrees=True).as_matrix()
    np.testing.assert_allclose(list(AXES.orientation(R).values()), [10.0, -20.0, 30.0])
