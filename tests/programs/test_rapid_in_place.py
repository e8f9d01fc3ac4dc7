"""RAPID back with only its targets changed: byte for byte outside of them, and the commanded path in them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.integrations.abb.language.in_place import write_rapid_in_place
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.robot_text.in_place import InPlaceText
from rapid_points import rapid_points

_TOLERANCE_M = 5.0 * UM
_ROUNDING_M = 0.1 * UM
REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
DOWN = f"[0,0,1,0],{REST}"


def at(x: float, y: float, z: float) -> str:
    """A robtarget with the tool down."""
    return f"[[{x},{y},{z}],{DOWN}]"


def corrected(program: RapidProgram, size_m: float, waves: float, turn_rad: float = 0.0) -> CompensatedPath:
    """A correction that grows from nothing behind the first motion and swings along the path."""
    path = tool_path(program, step_m=0.5 * MM)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    share = way / max(way[-1], 1e-9)
    shape = np.sin(0.5 * np.pi * np.minimum(1.0, share * 4.0)) * (1.0 + 0.5 * np.sin(waves * share))
    shape[path.motion == 0] = 0.0
    correction = size_m * shape[:, None] * np.array([0.3, 1.0, 0.6])
    return CompensatedPath.from_correction(path, correction, turn_rad * shape[:, None] * np.array([1.0, 0.4, 0.0]))


def gap_to_polyline(points: Float, line: Float) -> float:
    """Largest distance of points from a polyline."""
    a, b = line[:-1], line[1:]
    step = b - a
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    share = np.clip(np.einsum("pij,ij->pi", points[:, None] - a[None], step) / length2, 0.0, 1.0)
    near = a[None] + share[..., None] * step[None]
    return float(np.linalg.norm(points[:, None] - near, axis=2).min(axis=1).max())


OTHERS = (
    "! a comment; with MoveL p1", "", "SetDO doOne, 1;", "WaitTime 0.5;", "ConfL\\Off;",
    "IF a>1 THEN\n  Set b;\nENDIF",
)  # fmt: skip
FORMS = ("lit", "lit ! here", "name", "offs", "rel")


@st.composite
def modules(draw: st.DrawFn) -> str:
    """Straight motions of all forms, with whatever else a post writes between them, in two routines."""
    newline = draw(st.sampled_from(["\n", "\r\n"]))
    declared, bodies = [], {"main": [f"MoveJ {at(0, 0, 100)},v500,fine,tool0;"], "sub": []}
    for number in range(draw(st.integers(1, 5))):
        body = bodies[draw(st.sampled_from(["main", "main", "sub"]))]
        body += draw(st.lists(st.sampled_from(OTHERS), max_size=2))
        x, y, z = (draw(st.integers(-30_000, 30_000)) / 1000.0 for _ in range(3))
        form = draw(st.sampled_from(FORMS))
        target = at(x, y, z)
        if "lit" not in form:
            declared.append(f"CONST robtarget p{number}:={target}; ! p")
            named = f"p{number}"
            target = {"name": named, "offs": f"Offs({named},0,1.5,-2)", "rel": f"RelTool({named},0,0,5)"}[form]
        speed, zone = draw(st.sampled_from(["v50", "v50\\V:=33.5"])), draw(st.sampled_from(["fine", "z1"]))
        behind = " ! here" if "!" in form else ""
        body.append(f"MoveL {target},{speed},{zone},tool0\\WObj:=wobj0;{behind}")
    bodies["main"] += ["sub;"] * draw(st.integers(1, 2))
    routines = "".join(f"  PROC {name}()\n" + "".join(f"    {line}\n" for line in body) + "  ENDPROC\n"
                       for name, body in bodies.items())  # fmt: skip
    text = "MODULE part_m\n" + "".join(f"  {line}\n" for line in declared) + f"\n{routines}ENDMODULE\n"
    return text.replace("\n", newline)


def skeleton(text: str) -> str:
    """The text without the numbers of targets, options V and blanks."""
    text = re.sub(r"\\V:=[-\d.]+", "", text)
    return re.sub(r"[-+]?\d+\.?\d*(E[-+]?\d+)?", "#", text)


def read_back(text: InPlaceText) -> RapidProgram:
    """The written module, read again."""
    ((name, module),) = text.files.items()
    return read_rapid(module, name=name)


@settings(max_examples=40, deadline=None)
@given(modules(), st.floats(0.0, 800.0), st.floats(0.0, 30.0), st.sampled_from([0.0, 0.002]))
def test_only_targets_change(source: str, size_um: float, waves: float, turn: float) -> None:
    """Lines stay in order but for targets and speeds, and the targets lead along the commanded path."""
    program = read_rapid(source, name="part.mod")
    compensated = corrected(program, size_um * UM, waves, turn)
    text = write_rapid_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    after = text.files["part.mod"]
    if not compensated.moved.any() and not compensated.turned.any():
        assert after == source
        return
    if "\r\n" in source:
        assert "\n" not in after.replace("\r\n", "")
    target = re.compile(r"(MoveL ).*?(,v50)")
    old, new = ([skeleton(target.sub(r"\1\2", line)) for line in re.split(r"\r?\n", t)] for t in (source, after))
    rest = iter(new)
    if not text.routines_copied:
        for line in old:
            assert any(line == other for other in rest), line
        assert len(new) - len(old) == text.vertices_added + 2
    back = read_back(text)
    assert text.largest_written_error_m <= _TOLERANCE_M + _ROUNDING_M
    ends = np.array([program.motions[0].p_start, *(motion.p_end for motion in back.motions)])
    fed = np.array([motion.kind == "feed" for motion in program.motions])[compensated.path.motion]
    if fed.any():
        assert gap_to_polyline(compensated.p_part_command[fed], ends) <= _TOLERANCE_M + _ROUNDING_M
    other = rapid_points(after)
    np.testing.assert_allclose(
        [point.points[-1] for point in other], [m.p_end / MM for m in back.motions if m.kind != "dwell"], atol=1e-9
    )


MODULE = (
    "MODULE m\n  CONST robtarget p1:=" + at(10, 0, 5) + ";\n  CONST robtarget p2:=" + at(40, 0, 5) + ";\n"
    "  PROC main()\n    MoveJ " + at(0, 0, 50) + ",v500,fine,tool0;\n    cut;\n"
    "    MoveL Offs(p1,0,0,20),v50,z1,tool0;\n    cut;\n  ENDPROC\n\n"
    "  LOCAL PROC cut()\n    MoveL p1,v20,z1,tool0;\n    MoveL p2,v20,fine,tool0; ! groove\n  ENDPROC\nENDMODULE\n"
)  # fmt: skip


def test_a_routine_called_twice_is_written_once_for_each_call() -> None:
    """Every call needs its own targets: the second gets a copy; where both need the same there is none."""
    program = read_rapid(MODULE, name="m.mod")
    text = write_rapid_in_place(program, corrected(program, 300.0 * UM, 3.0), cycle_s=1e-4)
    after = text.files["m.mod"]
    assert text.routines_copied == 1
    assert "    cut_2;\n" in after
    assert "LOCAL PROC cut_2()" in after
    assert after.index("CONST robtarget p1:=" + at(10, 0, 5)) > 0  # used elsewhere too: written out, not changed
    back = read_back(text)
    first, second = (np.array([m.p_end for m, move in zip(back.motions, back.moves, strict=True) if move.call == call])
                     for call in (1, 2))  # fmt: skip
    assert np.abs(first[-1] - second[-1]).max() > 10.0 * UM
    path = tool_path(program, step_m=0.5 * MM)
    shift = np.zeros((len(path), 3))
    shift[path.kind == 1] = [0.0, 1e-4, 0.0]  # the same everywhere
    text = write_rapid_in_place(program, CompensatedPath.from_correction(path, shift), cycle_s=1e-4)
    assert text.routines_copied == (0 if "cut_2" not in text.files["m.mod"] else 1)
    np.testing.assert_allclose(read_back(text).motions[-1].p_end, [0.04, 1e-4, 0.005], atol=1e-9)


CIRCLE = (
    "MODULE m\n  CONST robtarget via:=" + at(14.142, 14.142, 5) + ";\n  PROC main()\n"
    "    MoveL " + at(20, 0, 5) + ",v20,z1,tool0;\n    MoveC via," + at(0, 20, 5) + ",v20,z1,tool0; ! a quarter\n"
    "    MoveL " + at(-20, 20, 5) + ",v20,fine,tool0;\n  ENDPROC\nENDMODULE\n"
)  # fmt: skip


def test_a_circle_stays_a_circle_where_its_points_lie_on_one() -> None:
    """Moved as a whole: the same circle elsewhere; swinging: straight moves, in the same place of the program."""
    program = read_rapid(CIRCLE, name="m.mod")
    path = tool_path(program, step_m=0.25 * MM)
    whole = np.tile(np.array([1e-4, 2e-4, 0.0]), (len(path), 1))
    whole[0] = 0.0
    text = write_rapid_in_place(program, CompensatedPath.from_correction(path, whole), cycle_s=1e-4)
    assert (text.arcs_kept, text.arcs_as_lines) == (1, 0)
    assert "CONST robtarget via:=[[14.2420,14.3420,5]," in text.files["m.mod"]
    arc = next(motion for motion in read_back(text).motions if motion.kind == "arc")
    assert arc.p_centre is not None
    np.testing.assert_allclose(arc.p_centre, [1e-4, 2e-4, 5e-3], atol=1e-6)
    assert arc.turn_rad == pytest.approx(program.motions[1].turn_rad, abs=1e-4)
    text = write_rapid_in_place(program, corrected(program, 3e-4, 60.0), cycle_s=1e-4)
    assert (text.arcs_kept, text.arcs_as_lines) == (0, 1)
    assert "! a quarter" in text.files["m.mod"]
    assert "MoveC" not in text.files["m.mod"]


def test_a_speed_is_an_option_of_its_instruction() -> None:
    """Lower where the plan lowers it, in the instruction itself; names and other speeds stay."""
    program = read_rapid(CIRCLE.replace("MoveC via," + at(0, 20, 5), "MoveL " + at(0, 20, 5)), name="m.mod")
    path = tool_path(program, step_m=0.25 * MM)
    slowed = path.feed_m_s.copy()
    slowed[path.motion == 1] *= 0.5
    object.__setattr__(path, "feed_m_s", slowed)
    text = write_rapid_in_place(program, CompensatedPath.nominal(path), cycle_s=1e-4)
    assert text.files["m.mod"].count("v20\\V:=10.0000,z1") == 1
    assert [m.feed_m_s for m in read_back(text).motions] == [0.0, 0.01, 0.02]


def test_a_function_in_a_target_leaves_its_statement_as_it_is() -> None:
    """A FUNC runs lines of its own: the motion keeps its line, and its compact IF guards all of its pieces."""
    source = """MODULE m
PERS tooldata t:=[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
CONST robtarget p:=[[0,0,50],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
FUNC robtarget at(num x)
RETURN Offs(p,x,0,0);
ENDFUNC
PROC main()
VAR num n:=3;
MoveL at(0),v20,fine,t;
IF n=3 MoveL at(60),v20,fine,t;
ENDPROC
ENDMODULE
"""
    program = read_rapid(source, name="part.mod")
    assert [program.blocks[motion.block].line for motion in program.motions] == [9, 10]
    text = write_rapid_in_place(program, corrected(program, 300.0 * UM, 9.0), tolerance_m=5.0 * UM, cycle_s=1e-3)
    behind = text.files["part.mod"].split("IF n=3")[1]
    assert behind.startswith(" THEN")
    assert behind.count("MoveL") > 2
    assert behind.index("ENDIF") > behind.rindex("MoveL")
