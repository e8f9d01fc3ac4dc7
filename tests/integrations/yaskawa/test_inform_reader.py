"""Reader of INFORM: the same part in KRL and RAPID, values, branches, frames; what it refuses."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.integrations.kuka.language.read.reader import read_krl
from counterflex.integrations.yaskawa.language.program import InformProgram
from counterflex.integrations.yaskawa.language.reader import read_inform, read_inform_file
from counterflex.integrations.yaskawa.language.source import InformFolder, job_files
from counterflex.integrations.yaskawa.language.table import TABLE
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.statement_table import Treatment
from inform_jobs import DOWN, HEADER, cell, job, point, points

Place = tuple[float, float, float]


def ends(program: RobotProgram) -> np.ndarray:
    """(n, 3) mm, ends of motions."""
    return np.array([motion.p_end for motion in program.motions]) / MM


@st.composite
def parts(draw: st.DrawFn) -> list[tuple[str, list[Place], Place, float]]:
    """Straight motions and arcs: kind, points, angles, speed in mm/s."""
    number = st.integers(-20_000, 20_000).map(lambda value: value / 1000.0)
    turn = st.sampled_from([DOWN, (170.0, 5.0, -175.0), (-30.0, 40.0, 110.0), (12.5, -60.25, 0.0)])
    out = []
    for _ in range(draw(st.integers(1, 5))):
        speed = draw(st.integers(1, 1500)) / 10.0
        if draw(st.booleans()):
            out.append(("L", [draw(st.tuples(number, number, number))], draw(turn), speed))
        else:
            x, y, z, size = (draw(number) for _ in range(4))
            size = abs(size) + 5.0
            out.append(("C", [(x + size, y, z), (x, y + size, z), (x - size, y, z)], draw(turn), speed))
    return out


def in_inform(part: Sequence[tuple[str, list[Place], Place, float]]) -> str:
    """The part as a job; an arc begins at its first point, which a MOVL goes to."""
    entries, lines = [point("C", 0, (0, 0, 90))], ["MOVJ C00000 VJ=10.00"]
    for kind, places, turn, speed in part:
        for k, place in enumerate(places if kind == "L" else [places[0], *places]):
            word = "MOVL" if kind == "L" or k == 0 else "MOVC"
            lines.append(f"{word} C{len(entries):05d} V={speed:.1f}")
            entries.append(point("C", len(entries), place, turn))
    return job(*lines, entries=entries)


def in_krl(part: Sequence[tuple[str, list[Place], Place, float]]) -> str:
    def frame(place: Place, turn: Place) -> str:
        (x, y, z), (a, b, c) = place, turn
        return f"{{X {x},Y {y},Z {z},A {c},B {b},C {a}}}"

    lines = [f"PTP {frame((0.0, 0.0, 90.0), DOWN)}"]
    for kind, places, turn, speed in part:
        lines += [f"$VEL.CP={speed / 1000.0}", f"LIN {frame(places[0], turn)}"]
        if kind == "C":
            lines.append(f"CIRC {frame(places[1], turn)},{frame(places[2], turn)}")
    return "\n".join(["DEF part( )", "BAS (#INITMOV,0)", *lines, "END", ""])


def in_rapid(part: Sequence[tuple[str, list[Place], Place, float]]) -> str:
    def target(place: Place, turn: Place) -> str:
        x, y, z, w = Rotation.from_euler("xyz", turn, degrees=True).as_quat()
        q = ",".join(f"{value:.12f}" for value in (w, x, y, z))
        return f"[[{place[0]},{place[1]},{place[2]}],[{q}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"

    lines = [f"MoveJ {target((0.0, 0.0, 90.0), DOWN)},v100,fine,tool1;"]
    for kind, places, turn, speed in part:
        rest = f"[{speed},5e6,5000,1000],fine,tool1;"  # no turn takes longer than its way, as in the other two
        lines.append(f"MoveL {target(places[0], turn)},{rest}")
        if kind == "C":
            lines.append(f"MoveC {target(places[1], turn)},{target(places[2], turn)},{rest}")
    tool = "PERS tooldata tool1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
    return "\n".join(["MODULE part", tool, "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""])


@settings(max_examples=40, deadline=None)
@given(parts())
def test_the_same_part_in_krl_and_rapid_is_the_same_path(part: list[tuple[str, list[Place], Place, float]]) -> None:
    """Ends, orientations, speeds and circles agree with what the readers of two other languages find."""
    own = read_inform(in_inform(part))
    for other, tolerance in ((read_krl(in_krl(part)), 1e-12), (read_rapid(in_rapid(part)), 1e-9)):
        assert [m.kind for m in own.motions] == [m.kind for m in other.motions]
        for a, b, R, S in zip(own.motions, other.motions, own.Rs_part_tcp, other.Rs_part_tcp, strict=True):  # type: ignore[arg-type]
            np.testing.assert_allclose(a.p_end, b.p_end, atol=tolerance)
            np.testing.assert_allclose(R, S, atol=1e-9)
            assert a.feed_m_s == pytest.approx(b.feed_m_s, rel=1e-9)
            assert a.turn_rad == pytest.approx(b.turn_rad, abs=1e-6)
            if a.kind == "arc":
                np.testing.assert_allclose(a.p_centre, b.p_centre, atol=1e-9)  # type: ignore[arg-type]


def test_a_full_circle_and_a_chain_on_one_circle() -> None:
    """Five points around a circle make one turn; where FPT stands the arc may change its circle."""
    corners = [(10 * math.cos(a), 10 * math.sin(a), 0.0) for a in np.linspace(0.0, 2.0 * math.pi, 5)]
    row = [f"MOVC C{k:05d} V=10.0" for k in range(5)]
    made = read_inform(job("MOVJ C00000 VJ=5.00", *row, entries=points(*corners)))
    assert [m.kind for m in made.motions] == ["rapid", "arc"]
    assert made.motions[1].turn_rad == pytest.approx(2.0 * math.pi)
    np.testing.assert_allclose(made.motions[1].p_centre, np.zeros(3), atol=1e-9)  # type: ignore[arg-type]
    other = [(20, 0, 0), (30, 10, 0), (40, 0, 0), (40, -20, 0), (20, -20, 0)]
    with pytest.raises(ProgramError, match="no single circle"):
        read_inform(job(*(f"MOVC C{k:05d} V=10.0" for k in range(5)), entries=points(*other)))
    lines = [f"MOVC C{k:05d} V=10.0{' FPT' if k == 2 else ''}" for k in range(5)]
    made = read_inform(job(*lines, entries=points(*other)))
    assert [m.kind for m in made.motions] == ["rapid", "arc", "arc"]


def test_an_arc_begins_with_a_straight_way_to_its_first_point() -> None:
    """The robot goes straight to the first MOVC (INFORM language manual); other speeds between points make pieces."""
    lines = (
        "MOVJ C00000 VJ=5.00",
        "MOVC C00001 V=30.0",
        "MOVC C00002 V=10.0",
        "MOVC C00003 V=20.0",
        "MOVL C00000 V=5.0",
    )
    made = read_inform(job(*lines, entries=points((0, 0, 0), (10, 0, 0), (20, 10, 0), (30, 0, 0))))
    assert [m.kind for m in made.motions] == ["rapid", "feed", "arc", "arc", "feed"]
    np.testing.assert_allclose([m.feed_m_s * 1e3 for m in made.motions], [0.0, 30.0, 10.0, 20.0, 5.0])
    np.testing.assert_allclose([abs(m.turn_rad) for m in made.motions[2:4]], [math.pi / 2.0] * 2)
    assert [b.motion_count for b in made.blocks] == [1, 1, 1, 1, 1]


def lines_of(program: InformProgram) -> list[int]:
    """Line of each motion."""
    return [program.blocks[motion.block].line for motion in program.motions]


FLOW: dict[str, tuple[tuple[str, ...], list[Place]]] = {
    "a loop": (("SET I000 0", "WHILEEXP I000<3", "MOVL P001 V=5.0", "ADD P001 P002", "INC I000", "ENDWHILE"),
               [(0, 0, 0), (1, 0, 0), (2, 0, 0)]),
    "for": (("FOR B001=1 TO 5 STEP 2", "MOVL P001 V=5.0", "ADD P001 P002", "NEXT B001"),
            [(0, 0, 0), (1, 0, 0), (2, 0, 0)]),
    "if": (("SET B000 2", "IFTHENEXP B000=1", "MOVL C00000 V=5.0", "ELSEIFEXP B000=2", "MOVL C00001 V=5.0", "ELSE",
            "MOVL C00000 V=5.0", "ENDIF"), [(9, 9, 9)]),
    "switch": (("SET B000 7", "SWITCH B000", "CASE 1", "MOVL C00000 V=5.0", "CASE 7", "MOVL C00001 V=5.0", "DEFAULT",
                "MOVL C00000 V=5.0", "ENDSWITCH"), [(9, 9, 9)]),
    "an element": (("SETE P001 (3) 2500", "GETE D001 P001 (3)", "SETE P001 (1) D001", "MOVL P001 V=5.0"),
                   [(2.5, 0, 2.5)]),
    "an index": (("SET B000 1", "SET P[B000] P002", "MOVL P[1] V=5.0"), [(1, 0, 0)]),
    "an expression": (("SET I001 (2+3)*4", "JUMP *A IF I001=20", "MOVL C00000 V=5.0", "*A", "MOVL C00001 V=5.0"),
                      [(9, 9, 9)]),
    "an input waited for": (("*W", "TIMER T=0.10", "JUMP *W IF IN#(3)=OFF", "MOVL C00001 V=5.0"), [(9, 9, 9)]),
    "an alarm": (("JUMP *ERR IF IN#(1)=OFF", "MOVL C00001 V=5.0", "RET", "*ERR", "SETUALM 8000 \"air\" 0", "ABORT"),
                 [(9, 9, 9)]),
    "a shift": (("MOVL C00001 V=5.0", "SFTON P002 UF#(1)", "MOVL C00001 V=5.0", "SFTOF", "MOVL C00001 V=5.0"),
                [(9, 9, 9), (10, 9, 9), (9, 9, 9)]),
    "increments": (("MOVL C00001 V=5.0", "IMOV P002 V=5.0 UF#(1)", "IMOV P002 V=5.0 TF"),
                   [(9, 9, 9), (10, 9, 9), (9, 9, 9)]),
    "speed": (("SPEED V=12.5", "MOVL C00001"), [(9, 9, 9)]),
}  # fmt: skip
OF_FLOW = [*points((0, 0, 0), (9, 9, 9)), point("P", 1, (0, 0, 0)), point("P", 2, (1, 0, 0), (0, 0, 0))]


@pytest.mark.parametrize("name", FLOW)
def test_what_is_executed(name: str) -> None:
    lines, expected = FLOW[name]
    made = read_inform(job(*lines, entries=OF_FLOW))
    np.testing.assert_allclose(ends(made), expected, atol=1e-9)


def test_process_words_tools_and_stops_by_the_cell() -> None:
    made = read_inform(
        job("CALL JOB:TOOL4", "MOVJ C00000 VJ=5.00", "AOUT AO#(1) 12000", "DOUT OT#(1) ON", "MOVL C00001 V=20.0",
            "DOUT OT#(9) ON", "DOUT OT#(1) OFF", "PAUSE", entries=points((0, 0, 50), (0, 0, 10))),
        cell=cell(),
    )  # fmt: skip
    assert [motion.tool for motion in made.motions] == [4, 4]
    np.testing.assert_allclose([m.spindle_rad_s for m in made.motions], [0.0, 12000 * RPM])
    words = [(word.letter, word.value) for block in made.blocks for word in block.words if word.letter in "MST"]
    assert words == [("M", 6.0), ("T", 4.0), ("M", 3.0), ("S", 12000.0), ("M", 5.0), ("M", 0.0)]
    assert made.acting == (22,)


def test_positions_in_the_frame_of_the_robot_are_seen_from_the_part() -> None:
    """///POSTYPE BASE is the robot's frame; the part frame of the cell stands in it, turned about z."""
    T = pose.make(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([1.0, 0.5, 0.2]))
    header = ("///TOOL 1", "///POSTYPE BASE", "///RECTAN", "///RCONF 0,0,0,0,0,0")
    made = read_inform(
        job("MOVL C00000 V=5.0", entries=points((1010, 500, 200)), header=header), cell=cell(T_base_part=T)
    )
    np.testing.assert_allclose(ends(made)[0], [0.0, -10.0, 0.0], atol=1e-9)
    with pytest.raises(ProgramError, match="another frame than the part frame"):
        read_inform(job("MOVL C00000 V=5.0", entries=points((0, 0, 0)),
                        header=[line.replace("USER 1", "USER 2") for line in HEADER]), cell=cell())  # fmt: skip


def test_a_frame_that_the_job_makes() -> None:
    """MFRAME from origin, a point on x and one in the plane: the frame of the cell, or another one seen from it."""
    base = ("///TOOL 1", "///POSTYPE BASE", "///RECTAN", "///RCONF 0,0,0,0,0,0")
    corners = [
        point("P", k, place, (0, 0, 0)) for k, place in enumerate([(1000, 500, 200), (1000, 700, 200), (900, 500, 200)])
    ]
    user = [*(line.replace("USER 1", "USER 5") for line in HEADER), point("C", 0, (10, 0, 0))]
    source = job("MFRAME UF#(5) P000 P001 P002", "MOVL C00000 V=5.0", entries=[*corners, *user], header=base)
    T = pose.make(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([1.0, 0.5, 0.2]))
    np.testing.assert_allclose(
        ends(read_inform(source, cell=cell(T_base_part=T, base_number=5)))[0], [10, 0, 0], atol=1e-9
    )
    np.testing.assert_allclose(ends(read_inform(source, cell=cell(base_number=1)))[0], [1000, 510, 200], atol=1e-9)


PULSES = ("///TOOL 1", "///POSTYPE PULSE", "///PULSE", "C00000=1000,2000,3000,4000,5000,6000")


def test_pulses_are_axes_by_what_the_cell_says_of_them_and_unknown_otherwise() -> None:
    """A place in pulses before the first target is none of the path; between targets it needs pulses_per_deg."""
    rest = [*HEADER, point("C", 1, (0, 0, 10)), point("C", 2, (5, 0, 10))]
    lines = ("MOVJ C00000 VJ=5.00", "MOVL C00001 V=5.0", "MOVL C00002 V=5.0", "MOVJ C00000 VJ=5.00")
    made = read_inform(job(*lines, entries=rest, header=PULSES), cell=cell())
    np.testing.assert_allclose(ends(made), [(0, 0, 10), (5, 0, 10)])
    assert made.left_out == ("program.jbi:21", "program.jbi:24")
    asked: list[Sequence[float]] = []

    def tip(axes_deg: Sequence[float], external: object) -> np.ndarray:
        asked.append(axes_deg)
        return pose.make(p=np.array([0.0, 0.0, 0.3]))

    between = job(*lines, "MOVL C00001 V=5.0", entries=rest, header=PULSES)
    with pytest.raises(
        ProgramError, match="program.jbi:25:1: the robot comes from a place that is not known"
    ) as caught:
        read_inform(between, cell=cell(tip_of_axes=tip))
    assert "pulses_per_deg" in str(caught.value)
    ratio = (1000.0, 1000.0, 1000.0, 500.0, 500.0, 250.0)
    made = read_inform(between, cell=cell(tip_of_axes=tip, pulses_per_deg=ratio))
    np.testing.assert_allclose(asked[0], [1, 2, 3, 8, 10, 24])
    assert [m.kind for m in made.motions] == ["rapid", "feed", "rapid", "feed"]
    np.testing.assert_allclose(made.axes_deg[2], [1, 2, 3, 8, 10, 24])
    with pytest.raises(ProgramError, match=r"program.jbi:21:1: where a motion goes is not known.*pulses_per_deg"):
        read_inform(job("MOVL C00000 V=5.0", entries=rest, header=PULSES), cell=cell())


P2 = points((0, 0, 50), (1, 0, 50))
BAD = {
    "a spline": (job("MOVS C00000 V=5.0", entries=P2), r"part.jbi:17:1: MOVS: .*the controller's own"),
    "a speed by a variable": (job("MOVL C00000 V=I004", entries=P2), r":17:15: the speed of a motion is not known"),
    "cm/min": (job("MOVL C00000 V=9000", entries=P2), r":17:15: this is no speed in mm/s.*1500"),
    "no speed": (job("MOVL C00000", entries=P2), r"the speed of a motion is not known: no V, and no SPEED"),
    "turning speed": (job("MOVL C00000 VR=5.0", entries=P2), r":17:13: an option .*that of turning"),
    "an input ends it": (job("MOVL C00000 V=5.0 UNTIL IN#(1)=ON", entries=P2), r":17:19: an option .*an input ends"),
    "another group": (job("MOVL C00000 V=5.0 +MOVL C00001 V=5.0", entries=P2), r":17:19: an option .*another group"),
    "no position": (job("MOVL V=5.0", entries=P2), r"names no position"),
    "no entry": (job("MOVL C00009 V=5.0", entries=P2), r"where C00009 is, is not known"),
    "a variable of the controller": (job("MOVL P009 V=5.0", entries=P2), r"not known: P009: the job does not set it"),
    "two points": (job("MOVC C00000 V=5.0", "MOVC C00001 V=5.0", entries=P2), r":17:1: an arc has fewer than three"),
    "a dwell in an arc": (job("MOVC C00000 V=5.0", "MOVC C00001 V=5.0", "MOVC C00002 V=5.0", "TIMER T=1.00",
        "MOVC C00001 V=5.0", entries=points((0, 0, 0), (1, 1, 0), (2, 0, 0))), r"22:1: a dwell stands between"),
    "a motion under IF": (job("IFTHENEXP IN#(1)=ON", "MOVL C00000 V=5.0", "ENDIF", entries=P2),
        r":18:1: whether .*inside IFTHENEXP"),
    "a jump over a motion": (job("JUMP *A IF IN#(1)=ON", "MOVL C00000 V=5.0", "*A", entries=P2), r"inside JUMP"),
    "without end": (job("*A", "MOVL C00000 V=5.0", "JUMP *A", entries=P2), r":19:1: the job repeats from line 17"),
    "no label": (job("JUMP *B", entries=P2), r"there is no label \*B"),
    "a call": (job("CALL JOB:OTHER", entries=P2), r"another job is called"),
    "no frame of an increment": (job("MOVL C00000 V=5.0", "IMOV P001 V=5.0", entries=P2), r"does not say the frame"),
    "an unknown word": (job("FOLD C00000", entries=P2), r"an unknown instruction"),
    "not closed": (job("WHILEEXP B000=1", entries=P2), r"WHILEEXP is not closed"),
    "twice": (job(entries=[*P2, P2[0]]), r":12:1: C00000 is there twice"),
    "no number": (job(entries=["C00000=1,2,x,4,5,6"]), r":10:12: a value of a position"),
    "five numbers": (job(entries=["C00000=1,2,3,4,5"]), r":10:1: a position has another number"),
    "no type": (job(entries=P2, header=("///TOOL 1",)), r"nothing says what the numbers"),
    "no end": (job(entries=P2).replace("END\n", ""), r"the job has no END"),
    "behind the end": (job(entries=P2) + "MOVL C00000 V=5.0\n", r":18:1: something follows END"),
    "another robot": (job(entries=P2).replace("RB1", "RB2"), r":15:1: the job moves another robot"),
    "another file": ("G1 X5\n", r"part.jbi:1:1: the file does not begin with /JOB"),
    "a byte too large": (job("SET B000 256", entries=P2), r"256 is beyond B variables"),
    "by zero": (job("SET I000 1", "DIV I000 0", entries=P2), r"a division by zero"),
    "two shifts": (job("SFTON P001 UF#(1)", "SFTON P001 UF#(1)", entries=[*P2, point("P", 1, (0, 0, 1), (0, 0, 0))]),
        r":19:1: a shift begins while another"),
    "a station that moves": (job("MOVL C00000 EC00000 V=5.0", "MOVL C00001 EC00001 V=5.0",
        entries=[*P2, "EC00000=100", "EC00001=200"]), r":20:1: an external axis moves"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_known_is_refused_in_one_line_with_its_place(name: str) -> None:
    text, message = BAD[name]
    with pytest.raises(ProgramError, match=message) as caught:
        read_inform(text, name="part.jbi")
    assert "\n" not in str(caught.value)
    assert re.match(r"part\.jbi:\d+(:\d+)?:", str(caught.value))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_text_is_read_or_refused_with_a_column(data: st.DataObject) -> None:
    """Valid jobs with characters, lines and numbers damaged, and lines of the language in any order."""
    samples = [sample for row in TABLE.rows for sample in row.samples]
    lines = data.draw(st.lists(st.sampled_from([*samples, "*A", "MOVL C00001 V=5.0", "MOVC C00000 V=5.0"]), max_size=8))
    text = job(*lines, entries=[*points((0, 0, 0), (9, 9, 9)), point("P", 0, (1, 0, 0))])
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 12))
        put = data.draw(
            st.one_of(st.just(""), st.text(max_size=6), st.sampled_from(["\n", "=", "1e999", "[", "C", "-", "'"]))
        )
        text = text[:at] + put + text[at + cut :]
    refused = ""
    try:
        made = read_inform(text, name="part.jbi", cell=data.draw(st.sampled_from([None, cell()])))
    except ProgramError as error:
        refused = str(error)
    if refused:
        assert re.fullmatch(r"part\.jbi:\d+:\d+: .*", refused), refused
        return
    assert len(made.moves) == len(made.motions)
    assert all(np.isfinite(motion.p_end).all() for motion in made.motions)


@pytest.mark.parametrize(
    "row", [row for row in TABLE.rows if row.treatment is Treatment.NEUTRAL], ids=lambda row: row.word
)
def test_neutral_instructions_leave_the_path_as_it_is(row: object) -> None:
    plain = ("MOVJ C00000 VJ=5.00", "MOVL C00001 V=5.0")
    for sample in row.samples:  # type: ignore[attr-defined]
        made = read_inform(job(plain[0], sample, plain[1], entries=P2))
        np.testing.assert_array_equal(ends(made), ends(read_inform(job(*plain, entries=P2))))


@pytest.mark.parametrize(
    "row", [row for row in TABLE.rows if row.treatment is Treatment.REFUSED], ids=lambda row: row.word
)
def test_refused_instructions_say_why(row: object) -> None:
    with pytest.raises(ProgramError) as caught:
        read_inform(job("MOVJ C00000 VJ=5.00", *row.samples, entries=P2))  # type: ignore[attr-defined]
    assert row.reason.split(":")[0] in str(caught.value)  # type: ignore[attr-defined]


def test_jobs_of_the_folder_are_run_and_variables_of_several_are_not_known(tmp_path: Path) -> None:
    sub = job("MOVL C00000 V=5.0", "SET B001 5", entries=[*points((7, 7, 7)), point("P", 1, (1, 1, 1))], name="SUB")
    (tmp_path / "SUB.JBI").write_text(sub)
    main = tmp_path / "MAIN.JBI"
    main.write_text(job("CALL JOB:SUB", "JUMP *A IF B001=5", "MOVL C00001 V=5.0", "*A", "CALL JOB:SUB", entries=P2))
    made = read_inform_file(main)
    np.testing.assert_allclose(ends(made), [(7, 7, 7), (7, 7, 7)])
    assert [block.file for block in made.blocks if block.motion_count] == ["SUB.JBI", "SUB.JBI"]
    assert job_files(main) == (tmp_path / "SUB.JBI",)
    assert list(made.jobs) == ["MAIN.JBI", "SUB.JBI"]
    clash = job("CALL JOB:SUB", "MOVL P001 V=5.0", entries=[*P2, point("P", 1, (2, 2, 2))])
    with pytest.raises(ProgramError, match="P001 is in several jobs with other values"):
        read_inform(clash, folder=InformFolder([tmp_path / "SUB.JBI"]))


def test_a_speed_without_decimals_may_be_in_cm_per_minute() -> None:
    made = read_inform(job("MOVL C00000 V=60", "MOVL C00001 V=60.0", entries=P2))
    assert made.doubts == (
        "V=60 in line 17 has no decimal and is read as 60 mm/s; a controller set to cm/min writes speeds so and goes "
        "10 mm/s",
    )
    assert read_inform(job("MOVL C00001 V=60.0", entries=P2)).doubts == ()


def test_a_target_of_a_variable_that_others_may_set_is_named() -> None:
    entries = [*P2, point("P", 1, (1, 2, 3))]
    made = read_inform(job("MOVL P001 V=5.0", "MOVL P001 V=5.0", entries=entries))
    assert made.doubts == (
        "P001 in line 18 and 1 more is read as //POS has it; another job of the controller may set it",
    )
    assert read_inform(job("SET P001 P001", "MOVL P001 V=5.0", entries=entries)).doubts == ()


def test_comments_behind_instructions_and_names_of_local_variables_are_passed() -> None:
    source = job("MOVL C00000 V=5.0 PL=0  //APPROACH", "SET B000 1 // count", "//MOVL C00001 V=5.0", entries=P2)
    made = read_inform(source.replace("NOP", "///LVARS 1,0,0,0,0,0,0,0\nLB000 counter\nNOP"))
    np.testing.assert_allclose(ends(made), [(0, 0, 50)])
    assert made.moves[0].exact
