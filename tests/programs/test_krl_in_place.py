"""KRL back with only its targets changed: byte for byte outside of them, and the commanded path in them."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.geometry import rotation
from counterflex.integrations.kuka.language.in_place import write_krl_in_place
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.robot_text.in_place import InPlaceText

_NUMBER = re.compile(r"[-+]?\d+\.?\d*")
_TOLERANCE_M = 5.0 * UM
_ROUNDING_M = 0.1 * UM


def corrected(program: KrlProgram, size_m: float, waves: float, turn_rad: float = 0.0) -> CompensatedPath:
    """A correction that grows from nothing behind the first motion and swings along the path."""
    path = tool_path(program, step_m=0.5 * MM)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    share = way / max(way[-1], 1e-9)
    shape = np.sin(0.5 * np.pi * np.minimum(1.0, share * 4.0)) * (1.0 + 0.5 * np.sin(waves * share))
    shape[path.motion == 0] = 0.0
    correction = size_m * shape[:, None] * np.array([0.3, 1.0, 0.6])
    rotvec = turn_rad * shape[:, None] * np.array([1.0, 0.4, 0.0])
    return CompensatedPath.from_correction(path, correction, rotvec)


def read_back(text: InPlaceText, program: KrlProgram) -> KrlProgram:
    """The written files, read again."""
    folder = {name: other for name, other in text.files.items() if name != program.name}
    return read_krl(text.files[program.name], name=program.name, folder=folder)


def skeletons(text: str) -> list[str]:
    """Lines with every number taken out, and the components of targets: one that was left out may be added."""
    return [re.sub(r",?\s*[XYZABC] #", "", _NUMBER.sub("#", line)) for line in re.split(r"\r?\n", text)]


def assert_only_targets(before: str, after: str, added: int) -> None:
    """Every line of the source is there in order but for numbers; as many lines more as the writer says."""
    old, new = skeletons(before), skeletons(after)
    rest = iter(new)
    for line in old:
        assert any(line == other for other in rest), line
    assert len(new) - len(old) == added


def gap_to_polyline(points: Float, line: Float) -> float:
    """Largest distance of points from a polyline."""
    a, b = line[:-1], line[1:]
    step = b - a
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    share = np.clip(np.einsum("pij,ij->pi", points[:, None] - a[None], step) / length2, 0.0, 1.0)
    near = a[None] + share[..., None] * step[None]
    return float(np.linalg.norm(points[:, None] - near, axis=2).min(axis=1).max())


POINT = st.tuples(*(st.integers(-30_000, 30_000),) * 3)


@dataclass(frozen=True)
class Source:
    """A random program: its two files."""

    source: str
    data: str


FORMS = ("LIN %s", "  lin %s C_DIS ; here", "SLIN %s", "PTP %s", "LIN {Z %s}", "LIN XP%s C_DIS")
OTHERS = (
    ";FOLD cut;%{PE}%R 8.3",
    ";ENDFOLD",
    "",
    "$OUT[3]=TRUE",
    "PULSE($OUT[4],TRUE,0.2)",
    "WAIT SEC 0.5",
    "WAIT FOR $IN[2]",
    "TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE",
    "TRIGGER WHEN PATH=-5 DELAY=0 DO $OUT[1]=FALSE",
    "  $VEL.CP = 0.03",
    "$ACC.CP=2.3 ; m/s2",
    "IF $IN[5] THEN\n$OUT[9]=TRUE\nENDIF",
    "HALT",
)


@st.composite
def programs(draw: st.DrawFn) -> Source:
    """Motions of all kinds, by literal and by name, with whatever else a post writes between them."""
    newline = draw(st.sampled_from(["\n", "\r\n"]))
    start = "PTP {X 0.0,Y 0.0,Z 100.0,A 90.0,B 0.0,C 180.0,S 2,T 35}"
    body, data = ["&ACCESS RVP", "DEF part( )", start, "$VEL.CP=0.05"], []
    for number, point in enumerate(draw(st.lists(POINT, min_size=1, max_size=5))):
        body += draw(st.lists(st.sampled_from(OTHERS), max_size=2))
        x, y, z = (value / 1000.0 for value in point)
        literal = f"{{X {x:.3f},Y {y:.3f}, Z {z:.3f},A 90.0,B 0.0,C 180.0}}"
        form = draw(st.sampled_from(FORMS))
        named = "XP" in form
        data += [f"DECL E6POS XP{number}={literal} ; P{number}"] if named else []
        body.append(form % (f"{number}" if named else f"{z:.3f}" if "Z" in form else literal))
    body += ["PTP XHOME", "END", "; behind the end", ""]
    listed = ["DEFDAT part", *data, "ENDDAT", ""]
    return Source("\n".join(body).replace("\n", newline), newline.join(listed))


@settings(max_examples=40, deadline=None)
@given(programs(), st.floats(0.0, 800.0), st.floats(0.0, 30.0), st.sampled_from([0.0, 0.002]))
def test_only_targets_change(source: Source, size_um: float, waves: float, turn: float) -> None:
    """Nothing else changes, and the targets lead along the commanded path."""
    program = read_krl(source.source, name="part.src", data=source.data, data_name="part.dat")
    compensated = corrected(program, size_um * UM, waves, turn)
    text, refused = None, "TRIGGER"
    try:
        text = write_krl_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    except ProgramError as fault:
        refused = str(fault)
    assert "TRIGGER" in refused
    if text is None:
        return
    if not compensated.moved.any() and not compensated.turned.any():
        assert text.files == {"part.src": source.source, "part.dat": source.data}
        return
    changed = text.files["part.src"] != source.source or text.files["part.dat"] != source.data
    assert changed
    assert_only_targets(source.source, text.files["part.src"], text.vertices_added + text.speeds_added + 2)
    assert_only_targets(source.data, text.files["part.dat"], 0)
    back = read_back(text, program)
    assert text.largest_written_error_m <= _TOLERANCE_M + _ROUNDING_M
    line = np.array([program.motions[0].p_start, *(motion.p_end for motion in back.motions)])
    fed = np.array([motion.kind == "feed" for motion in program.motions])[compensated.path.motion]
    if fed.any():
        assert gap_to_polyline(compensated.p_part_command[fed], line) <= _TOLERANCE_M + _ROUNDING_M
    assert [m.feed_m_s for m in back.motions if m.kind == "feed"][-1:] != [0.0]


CIRCLE = (
    "DEF part( )\nLIN {X 20.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n$VEL.CP=0.02\n"
    "CIRC {X 14.142,Y 14.142,Z 5.0},{X 0.0,Y 20.0,Z 5.0} C_DIS ; a quarter\nLIN {X -20.0}\nEND\n"
)


@pytest.mark.parametrize("angle", ["", ", CA 90.0", ", CA 200"])
def test_a_circle_stays_a_circle_where_its_points_lie_on_one(angle: str) -> None:
    """Moved as a whole: the same circle elsewhere; swinging: straight moves, in the same place of the program."""
    program = read_krl(CIRCLE.replace(" C_DIS", f"{angle} C_DIS"), name="part.src")
    path = tool_path(program, step_m=0.25 * MM)
    whole = np.where(path.motion[:, None] > 0, np.array([1e-4, 2e-4, 0.0]), 0.0)
    whole[path.motion == 0] = [1e-4, 2e-4, 0.0]
    whole[0] = 0.0
    text = write_krl_in_place(program, CompensatedPath.from_correction(path, whole), cycle_s=1e-4)
    assert (text.arcs_kept, text.arcs_as_lines) == (1, 0)
    arc = next(motion for motion in read_back(text, program).motions if motion.kind == "arc")
    assert arc.p_centre is not None
    np.testing.assert_allclose(arc.p_centre, [1e-4, 2e-4, 5e-3], atol=1e-6)
    assert arc.turn_rad == pytest.approx(program.motions[1].turn_rad, abs=1e-4)
    text = write_krl_in_place(program, corrected(program, 3e-4, 60.0), cycle_s=1e-4)
    assert (text.arcs_kept, text.arcs_as_lines) == (0, 1)
    assert "} C_DIS ; a quarter" in text.files["part.src"]
    back = read_back(text, program)
    line = np.array([motion.p_end for motion in back.motions])
    compensated = corrected(program, 3e-4, 60.0)
    assert gap_to_polyline(compensated.p_part_command[compensated.path.motion == 1], line) < _TOLERANCE_M + _ROUNDING_M


def test_a_name_that_is_used_twice_is_written_out() -> None:
    """Out and back over the same point: the .dat stays, both motions get their own literal, S and T included."""
    source = "DEF p( )\nPTP P1\n$VEL.CP=0.02\nLIN {X 30.0}\nLIN P1 C_DIS\nEND\n"
    data = "DEFDAT p\nDECL E6POS P1={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 180.0,S 2,T 35}\nENDDAT\n"
    program = read_krl(source, name="p.src", data=data, data_name="p.dat")
    text = write_krl_in_place(program, corrected(program, 1e-4, 3.0))
    assert text.files["p.dat"] == data
    assert text.targets_written_out == 1
    assert re.search(
        r"\nLIN \{X 0\.\d+,Y 0\.\d+,Z 0\.\d+,A 0\.0,B 0\.0,C 180\.0,S 2,T 35\} C_DIS\n", text.files["p.src"]
    )


def test_points_go_before_a_trigger_that_counts_from_the_end() -> None:
    """DISTANCE=1 acts at the end of the motion behind it: that must stay the programmed one."""
    lines = ["DEF p( )", "PTP {X 0,Y 0,Z 0,A 0,B 0,C 180}", "$VEL.CP=0.02"]
    lines += ["TRIGGER WHEN DISTANCE=1 DELAY=0 DO $OUT[1]=TRUE", "LIN {X 60}", "END", ""]
    program = read_krl("\n".join(lines), name="p.src")
    out = write_krl_in_place(program, corrected(program, 5e-4, 20.0)).files["p.src"].split("\n")
    at = next(i for i, line in enumerate(out) if line.startswith("TRIGGER"))
    following = [line for line in out[at + 1 :] if not line.startswith("$VEL")]
    assert following[0].startswith("LIN {X 60.")
    assert out[at - 1].startswith(("LIN", "$VEL"))
    assert sum(line.startswith("LIN") for line in out[:at]) > 3


def test_orientation_is_corrected_about_the_tool_as_it_is_held() -> None:
    """A B C of the written end: the programmed orientation turned by the correction."""
    program = read_krl("DEF p( )\nPTP {X 0,Y 0,Z 0,A 30,B 0,C 180}\n$VEL.CP=0.02\nLIN {X 60}\nEND\n", name="p.src")
    compensated = corrected(program, 1e-4, 2.0, 0.003)
    back = read_back(write_krl_in_place(program, compensated), program)
    assert back.Rs_part_tcp is not None
    assert program.Rs_part_tcp is not None
    wanted = rotation.exp(compensated.rotvec_part_command[-1]) @ program.Rs_part_tcp[-1]
    assert float(np.linalg.norm(rotation.log(wanted.T @ back.Rs_part_tcp[-1]))) < 2e-7


SPLINE = (
    "DEF part( )\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n$VEL.CP=0.02\nSPLINE\n"
    "  SLIN {X 20.0} ; one\n  SLIN {X 40.0} WITH $VEL.CP=0.01\nENDSPLINE\nSLIN {X 60.0}\nEND\n"
)


def test_segments_of_a_spline_block_stay_in_it() -> None:
    """Points put in are segments too, their speeds behind WITH; no other statement gets between them."""
    program = read_krl(SPLINE, name="part.src")
    path = tool_path(program, step_m=0.5 * MM)
    slowed = path.feed_m_s.copy()
    slowed[path.motion > 0] *= 0.5
    object.__setattr__(path, "feed_m_s", slowed)
    swing = 2e-4 * np.sin(path.p_part_tcp[:, :1] / 0.004) * np.array([0.0, 1.0, 0.0])
    text = write_krl_in_place(program, CompensatedPath.from_correction(path, swing), cycle_s=1e-4)
    after = text.files["part.src"]
    block = after[after.index("SPLINE") : after.index("ENDSPLINE")].splitlines()[1:]
    assert len(block) > 10
    assert all(line.strip().startswith("SLIN {") for line in block)
    assert sum("; one" in line for line in block) == 1
    back = read_back(text, program)
    assert text.largest_written_error_m <= _TOLERANCE_M + _ROUNDING_M
    cut = [m for m, move in zip(back.motions, back.moves, strict=True) if move.in_spline]
    assert {round(m.feed_m_s, 3) for m in cut} <= {0.010, 0.005, 0.011, 0.006}
    assert back.motions[-1].p_end[0] == pytest.approx(0.06)


def test_pieces_of_a_motion_with_its_own_variables_have_them_too() -> None:
    """Tool and base that hold for one motion alone are there for every piece of it; approximation behind them."""
    clause = "WITH $VEL = SVEL_CP( 0.02, , L), $TOOL = STOOL2( F), $BASE = SBASE( F.BASE_NO)"
    source = (
        "DEF part( )\n$BASE=BASE_DATA[1]\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n$VEL.CP=0.02\n"
        f"SLIN {{X 40.0}} {clause} C_SPL ; cut\nEND\n"
    )
    program = read_krl(source, name="part.src", data="DEFDAT part\nDECL FDAT F={TOOL_NO 1,BASE_NO 1}\nENDDAT\n")
    path = tool_path(program, step_m=0.5 * MM)
    slowed = path.feed_m_s.copy()
    slowed[path.motion > 0] *= 0.5
    object.__setattr__(path, "feed_m_s", slowed)
    swing = 2e-4 * np.sin(path.p_part_tcp[:, :1] / 0.004) * np.array([0.0, 1.0, 0.0])
    text = write_krl_in_place(program, CompensatedPath.from_correction(path, swing), cycle_s=1e-4)
    lines = [line for line in text.files["part.src"].splitlines() if line.startswith("SLIN")]
    assert len(lines) > 10
    form = re.compile(re.escape(clause).replace("0\\.02", r"(0\.\d+)") + r" C_SPL( ; cut)?$")
    assert all(form.search(line) for line in lines)
    back = read_back(text, program)
    assert {round(m.feed_m_s, 3) for m in back.motions[1:]} <= {0.010, 0.011}
    assert text.largest_written_error_m <= _TOLERANCE_M + _ROUNDING_M


def test_a_subprogram_is_corrected_where_it_stands() -> None:
    """One that is called once; one that is called several times needs targets for each call, and is refused."""
    sub = "DEF CUT( )\nLIN {X 20.0} C_DIS\nLIN {X 40.0} ; end\nEND\n"
    text = "DEF part( )\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n$VEL.CP=0.02\nCUT( )\nLIN {X 0.0}\nEND\n" + sub
    program = read_krl(text, name="part.src")
    made = write_krl_in_place(program, corrected(program, 3e-4, 5.0), cycle_s=1e-4)
    assert_only_targets(text, made.files["part.src"], made.vertices_added + made.speeds_added + 2)
    assert made.files["part.src"].split("DEF CUT")[1].count("LIN") > 4
    back = read_back(made, program)
    np.testing.assert_allclose(back.motions[-1].p_end, corrected(program, 3e-4, 5.0).p_part_command[-1], atol=1e-7)
    twice = read_krl(text.replace("LIN {X 0.0}\n", "CUT( )\n"), name="part.src")
    with pytest.raises(ProgramError, match="executed several times"):
        write_krl_in_place(twice, corrected(twice, 3e-4, 5.0), cycle_s=1e-4)


ELSEWHERE = {
    "a shifted base": "$BASE=BASE_DATA[1]:{X 3,Y -2,Z 5,A 30,B 0,C 0}\nLIN {X 20.0}\nLIN {X 40.0,Y 1.0}\n"
    "$BASE=BASE_DATA[1]\nLIN {X 60.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}",
    "computed targets": "P={X 20,Y 0,Z 5,A 0,B 0,C 180}\nLIN P ; first\nP.X=P.X+20\nLIN P C_DIS\nLIN P:{X 20}",
    "relative motions": "LIN {X 20.0}\nLIN_REL {X 20.0} C_DIS ; on\nLIN_REL {X 10.0} #BASE\nP=$POS_ACT\n"
    "P.X=P.X+5\nLIN P",
    "an override": "$OV_PRO=40\nLIN {X 20.0}\nLIN {X 40.0}\n$OV_PRO=100\nLIN {X 60.0}",
    "an unrolled loop": "FOR I=1 TO 1\nLIN {X 20.0*I}\nENDFOR\nLIN {X 60.0}",
    "an element used twice": "I=2\nLIN P[I]\nLIN {X 30.0}\nLIN P[2]\nLIN {X 60.0}",
    "an array": "I=2\nLIN P[I]\nLIN {X 60.0}",
    "a part": "PART( )\nLIN {X 60.0}",
}
PARTS = {
    "p.dat": "DEFDAT p\nDECL E6POS P[2]\nP[2]={X 20.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0,S 2}\nENDDAT\n",
    "PART.src": "DEF PART( )\r\nLIN {X 20.0}\r\nLIN XP1 C_DIS ; end\r\nEND\r\n",
    "part.dat": "DEFDAT part\nDECL E6POS XP1={X 40.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\nENDDAT\n",
    "other.src": "DEF other( )\nEND\n",
}


@pytest.mark.parametrize("what", ELSEWHERE)
def test_targets_that_are_no_literals_of_the_motion(what: str) -> None:
    """The written job leads along the commanded path, with the commanded speeds; without corrections it is the same."""
    start = "DEF p( )\n$BASE=BASE_DATA[1]\n$VEL.CP=0.02\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n"
    program = read_krl(f"{start}{ELSEWHERE[what]}\nEND\n", name="p.src", folder=PARTS)
    same = write_krl_in_place(program, corrected(program, 0.0, 0.0)).files
    assert same == {name: file.text for name, file in program.files.items()}
    assert "other.src" not in same
    compensated = corrected(program, 3e-4, 8.0, 0.001)
    text = write_krl_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    back = read_back(text, program)
    assert text.largest_written_error_m <= _TOLERANCE_M + _ROUNDING_M
    line = np.array([back.motions[0].p_start, *(motion.p_end for motion in back.motions)])
    assert gap_to_polyline(compensated.p_part_command, line) < _TOLERANCE_M + _ROUNDING_M
    assert back.Rs_part_tcp is not None
    assert program.Rs_part_tcp is not None
    wanted = rotation.exp(compensated.rotvec_part_command[-1]) @ program.Rs_part_tcp[-1]
    assert float(np.linalg.norm(rotation.log(wanted.T @ back.Rs_part_tcp[-1]))) < 3e-7
    for motion in back.motions[1:]:
        share = min(abs(motion.feed_m_s / other.feed_m_s - 1.0) for other in program.motions[1:])
        assert share < 0.1
    for name, file in program.files.items():
        assert text.files[name].count("\r\n") >= file.text.count("\r\n")


def test_a_line_of_a_loop_is_not_corrected_for_all_its_passes() -> None:
    start = "DEF p( )\n$VEL.CP=0.02\nLIN {X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 180.0}\n"
    program = read_krl(f"{start}FOR I=1 TO 2\nLIN {{X 20.0*I}}\nENDFOR\nEND\n", name="p.src")
    with pytest.raises(ProgramError, match=r"executed several times .*counterflex convert p.src --to krl"):
        write_krl_in_place(program, corrected(program, 3e-4, 8.0))
    constant = read_krl(f"{start}$ORI_TYPE=#CONSTANT\nLIN {{X 20.0}}\nEND\n", name="p.src")
    write_krl_in_place(constant, corrected(constant, 3e-4, 8.0))
    with pytest.raises(ProgramError, match=r"#CONSTANT disregards"):
        write_krl_in_place(constant, corrected(constant, 3e-4, 8.0, 0.001))
