"""The posture that a robot program states is the one that the maker's rules give for the axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.preflight import check
from counterflex.files.cell.cell import read_cell
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.integrations.fanuc.language.job import configuration as fanuc_configuration
from counterflex.integrations.fanuc.language.read.reader import read_fanuc
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.integrations.staubli.language.job import configuration as val3_configuration
from counterflex.integrations.staubli.language.read.reader import read_val3_file
from counterflex.programs.program import Program
from counterflex.programs.stated.two_readings import other_postures, stated_postures
from counterflex.robot.kinematics.inverse_seeds import branch_of
from counterflex.robot.model.opw import BRANCHES

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
KRL = (
    "DEF p( )\n$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[1]\n$VEL.CP=0.1\n"
    "PTP {{X 1,Y 2,Z 3,A 0,B 0,C 180,S {0},T 35}}\n{1}END\n"
)
RAPID = (
    "MODULE p\nPERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nPROC main()\n{1}"
    "MoveJ [[1,0,9],[0,1,0,0],[0,0,0,{0}],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,t1;\n"
    "MoveL [[1,0,0],[0,1,0,0],[0,0,0,{0}],[9E9,9E9,9E9,9E9,9E9,9E9]],v20,fine,t1;\nENDPROC\nENDMODULE\n"
)


def agreeing(program: Program, motion: int = 0) -> list[str]:
    posture, _ = stated_postures(program)[motion]
    return [branch for branch in BRANCHES if posture.agrees(branch)]


def arms(cell: str, count: int) -> list[tuple[float, float, float, str]]:
    """Where the wrist lies ahead of axis 1, to which side the arm is bent, axis 5, and the posture of random axes."""
    chain = read_cell(EXAMPLES / "cells" / cell).controller_chain
    opw, random = chain.opw, np.random.default_rng(3)
    assert opw is not None
    out: list[tuple[float, float, float, str]] = []
    while len(out) < count:
        q = np.asarray(random.uniform(chain.joint_limits_rad[:, 0], chain.joint_limits_rad[:, 1]))
        lift, bend = opw.signs[1] * q[1] - opw.offsets_rad[1], opw.signs[2] * q[2] - opw.offsets_rad[2]
        upper = opw.c2_m * np.exp(1j * (np.pi / 2 - lift))
        fore = complex(opw.c3_m, 0) * np.exp(1j * (np.pi / 2 - lift - bend)) + opw.a2_m * np.exp(1j * (-lift - bend))
        ahead, side = opw.a1_m + (upper + fore).real, -(upper.conjugate() * fore).imag
        fifth = opw.signs[4] * q[4] - opw.offsets_rad[4]
        if min(abs(ahead), abs(side), abs(fifth)) > 0.02:
            out.append((ahead, side, fifth, branch_of(chain, q)))
    return out


def test_status_of_krl_by_the_rules_of_kuka() -> None:
    for ahead, side, fifth, branch in arms("kr300_d16_small.toml", 40):
        status = (ahead < 0) + 2 * (side > 0) + 4 * (fifth < 0)
        assert agreeing(read_krl(KRL.format(status, ""), name="p.src")) == [branch]


def test_cfx_of_rapid_by_the_table_of_abb() -> None:
    for ahead, side, fifth, branch in arms("irb6640_d16.toml", 40):
        number = 4 * (ahead < 0) + 2 * (side < 0) + (fifth < 0)
        found = agreeing(read_rapid(RAPID.format(number, ""), name="p.mod"))
        assert branch in found
        assert len(found) == (1 if ahead > 0 else 2)


def test_a_configuration_that_is_not_supervised_is_no_posture() -> None:
    both = read_rapid(RAPID.format(1, "ConfJ\\Off;\nConfL \\Off;\n"), name="p.mod")
    linear = read_rapid(RAPID.format(1, "ConfJ\\Off;\n"), name="p.mod")
    remark = read_rapid(RAPID.format(1, "! ConfJ\\Off;\n"), name="p.mod")
    assert [sorted(stated_postures(one)) for one in (both, linear, remark)] == [[], [1], [0, 1]]


def test_status_counts_in_ptp_only() -> None:
    program = read_krl(KRL.format(2, "LIN {X 2,Y 2,Z 3,A 0,B 0,C 180,S 6,T 35}\n"), name="p.src")
    assert sorted(stated_postures(program)) == [0]
    assert other_postures(program, "front up noflip") == []
    (said,) = other_postures(program, "front up flip")
    assert said.startswith("p.src:5: ")
    assert "S 2" in said


@pytest.mark.parametrize("branch", BRANCHES)
def test_config_of_fanuc_and_val3_as_written(branch: str, tmp_path: Path) -> None:
    source = (EXAMPLES / "programs" / "groove.ls").read_text().replace("N U T, 0, 0, 0", fanuc_configuration(branch))
    assert agreeing(read_fanuc(source, name="groove.ls")) == [branch]
    for name in ("groove.pgx", "groove.dtx"):
        text = (EXAMPLES / "programs" / name).read_text()
        for old, new in zip(("righty", "epositive", "wpositive"), val3_configuration(branch), strict=True):
            text = text.replace(old, new)
        (tmp_path / name).write_text(text)
    assert agreeing(read_val3_file(tmp_path / "groove.pgx")) == [branch]


@pytest.mark.parametrize(
    ("config", "verdict"), [("N U T", "ok"), ("F U T", "fail"), ("N D T", "fail"), ("N U B", "fail")]
)
def test_preflight_compares_the_posture(config: str, verdict: str, tmp_path: Path) -> None:
    file = tmp_path / "groove.ls"
    file.write_text((EXAMPLES / "programs" / "groove.ls").read_text().replace("N U T", config))
    rows = check(file, read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")).summary["checks"]
    row = next(row for row in rows if row["check"] == "posture of the program")
    assert row["verdict"] == verdict
    assert bool(row["advice"]) == (verdict == "fail")
