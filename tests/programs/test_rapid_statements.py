"""Each statement of the table does what its row says: neutral ones change nothing, refused ones are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.instructions import HANDLERS
from counterflex.integrations.abb.language.read.interpreter import LEAVING
from counterflex.integrations.abb.language.read.reader import read_rapid
from counterflex.integrations.abb.language.table import ACTS, FORMS, FUNCTION_OUTPUTS, OUTPUTS, SETS_MOTION, TABLE
from counterflex.programs.approximation import approximation_m
from counterflex.programs.statement_table import Statement, Treatment

REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
DECLARED = (
    f"CONST robtarget p10:=[[0,0,0],[0,1,0,0],{REST}];\nCONST robtarget p20:=[[9,9,1],[0,1,0,0],{REST}];\n"
    f"CONST robtarget p30:=[[0,20,1],[0,1,0,0],{REST}];\nVAR num step:=5;\n"
    "CONST speeddata vOwn:=[17,500,5000,1000];\nVAR robtarget q:=p20;\n"
)
LINES = (
    "MoveL p20,v20,z1,tool0;", "MoveL Offs(p10,step,0,1),vOwn,fine,tool0;", "step:=step+1;",
     "MoveJ p30,v100,z50,tool0;",
    "MoveL p10,v20,z1,tool0;\nMoveC p20,p30,v50\\V:=33,z1,tool0;", "q:=p20;", "q.trans.z:=3;", "MoveL q,v20,z0,tool0;",
     "WaitTime 0.5;",
    "cut 2;", "IF step>6 cut 3;", "FOR i FROM 1 TO 2 DO\n{0}\nMoveL Offs(p30,i,step,i),v20,z1,tool0;\nENDFOR",
    "IF step<20 THEN\n{0}\nMoveL RelTool(p20,0,0,-2\\Rx:=1),v20,fine,tool0;\nENDIF", "PDispSet [[0,0,step],[1,0,0,0]];",
    "VelSet 50,1000;",
)  # fmt: skip
NEUTRAL = [sample for row in TABLE.of(Treatment.NEUTRAL) for sample in row.samples]
FUNCTIONS = [row for row in TABLE.rows if row.samples and row.samples[0].startswith("any:=")]


def module(body: str) -> str:
    start = "MoveJ p10,v100,fine,tool0;\n"
    cut = "PROC cut(num depth)\nMoveL Offs(p20,0,0,-depth),v20,fine,tool0;\nENDPROC\n"
    return f"MODULE m\n{DECLARED}PROC main()\n{start}{body}\nENDPROC\n{cut}ENDMODULE\n"


def path_of(program: RapidProgram) -> list[object]:
    """All that a plan needs of a program."""
    assert program.Rs_part_tcp is not None
    motions = [
        (m.kind, *np.round(m.p_end, 12), m.feed_m_s, m.turn_rad, m.duration_s, m.tool, m.spindle_rad_s)
        for m in program.motions
    ]
    return [*motions, np.round(program.Rs_part_tcp, 12).tolist(), str(approximation_m(program))]


@settings(max_examples=120, deadline=None)
@given(
    st.lists(st.sampled_from(LINES), min_size=1, max_size=6),
    st.lists(st.tuples(st.integers(0, 20), st.sampled_from(NEUTRAL)), min_size=1, max_size=8),
)
def test_neutral_statements_anywhere_change_nothing(lines: list[str], inserted: list[tuple[int, str]]) -> None:
    body = list(lines)
    before = path_of(read_rapid(module("\n".join(line.format("") for line in body))))
    inner = inserted[0][1]
    for place, sample in inserted:
        body.insert(place % (len(body) + 1), sample)
    after = read_rapid(module("\n".join(line.format(inner) if line in LINES else line for line in body)))
    assert path_of(after) == before


@pytest.mark.parametrize("sample", NEUTRAL)
def test_each_neutral_statement_is_read(sample: str) -> None:
    assert path_of(read_rapid(module(f"{sample}\nMoveL p20,v20,fine,tool0;"))) == path_of(
        read_rapid(module("MoveL p20,v20,fine,tool0;"))
    )


REFUSED = [row for row in TABLE.of(Treatment.REFUSED) if row not in FUNCTIONS]


@pytest.mark.parametrize("row", REFUSED, ids=lambda row: row.word)
def test_each_refused_statement_is_refused_with_its_remedy(row: Statement) -> None:
    with pytest.raises(ProgramError) as fault:
        read_rapid(module(f"{row.samples[0]}\nMoveL p20,v20,fine,tool0;"), name="m.mod")
    assert "m.mod:10:1" in str(fault.value)
    assert fault.value.hint
    if row.word == "RAISE":
        return  # behind a condition it ends the program, as EXIT does
    with pytest.raises(ProgramError):  # also where nobody knows whether it is executed
        read_rapid(module(f"IF di1=1 THEN\n{row.samples[0]}\nENDIF"))


def test_each_evaluated_instruction_has_what_evaluates_it() -> None:
    structure = {
        "MODULE", "ENDMODULE", "PROC", "ENDPROC", "FUNC", "ENDFUNC", "TRAP", "ENDTRAP", "RECORD", "ENDRECORD", "ALIAS",
        "CONST", "VAR", "PERS", ":=", "IF", "ELSEIF", "ELSE", "ENDIF", "FOR", "ENDFOR", "WHILE", "ENDWHILE", "TEST",
        "CASE", "DEFAULT", "ENDTEST", "ERROR", "UNDO", "BACKWARD", "CALLBYVAR",
    }  # fmt: skip
    words = {row.word.upper() for row in TABLE.of(Treatment.EVALUATED) if row not in FUNCTIONS}
    assert words - structure - set(FORMS) - set(HANDLERS) - LEAVING == set()
    known = {row.word.upper() for row in TABLE.rows}
    assert {*FORMS, *HANDLERS, *LEAVING, *OUTPUTS, *FUNCTION_OUTPUTS, *ACTS, *SETS_MOTION} - known == set()


@pytest.mark.parametrize("word", sorted(set(OUTPUTS) & {row.word.upper() for row in TABLE.of(Treatment.NEUTRAL)}))
def test_what_an_instruction_writes_is_unknown_behind_it(word: str) -> None:
    """The sample with ``step`` in place of its output: a target that needs it is refused with both lines."""
    places = OUTPUTS[word]
    count = max([place for place in places if isinstance(place, int)], default=-1) + 1
    given = ["step" if place in places else "x" for place in range(max(count, 1))]
    options = "".join(f"\\{place}:=step" for place in places if isinstance(place, str))
    body = f"{word} {','.join(given)}{options};\nMoveL Offs(p10,step,0,0),v20,fine,tool0;"
    with pytest.raises(ProgramError) as fault:
        read_rapid(module(body), name="m.mod")
    assert "m.mod:10" in str(fault.value)
    assert "m.mod:11" in str(fault.value)


@pytest.mark.parametrize("row", FUNCTIONS, ids=lambda row: row.word)
def test_a_function_is_computed_or_its_value_is_unknown(row: Statement) -> None:
    """A function that asks the controller makes what depends on it unknown; a computed one needs known arguments."""
    call = row.samples[0].removeprefix("any:=").rstrip(";")
    body = f"anything:={call};\nIF anything=1 MoveL p20,v20,fine,tool0;"
    if "computed" in row.reason:
        assert row.treatment is Treatment.EVALUATED
        return
    with pytest.raises(ProgramError) as fault:
        read_rapid(module(body).replace("VAR num step", "VAR num anything;\nVAR num step"), name="m.mod")
    assert f"{row.word}()" in str(fault.value)
