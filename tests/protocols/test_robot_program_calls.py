"""Robot programs of which the calls are read: damaged in any way they are read or refused in one line."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import CounterflexError
from counterflex.integrations.abb.link.calls import parse_egm_calls
from counterflex.integrations.kuka.link.calls import parse_calls

KRL = (
    'DEF groove()\nDECL INT ret, id ; x\nPTP {A1 0}\nret = RSI_CREATE("counterflex.rsi", id, TRUE)\n'
    'IF (ret <> RSIOK) THEN\nHALT\nENDIF\nret = RSI_SETPUBLICPAR(id, "POSCORR1", "LowerLimX", -3.6)\n'
    "WAIT FOR $SEN_PINT[1] == 1\nret = RSI_ON(#ABSOLUTE, #IPO_FAST)\nLIN {X 1.5, Y 2} C_VEL\n"
    "$SEN_PREA[1] = 4711\nret = RSI_OFF()\nEND\n"
)
RAPID = (
    "MODULE groove\n! x\nVAR egmident id;\nPROC main()\nEGMReset id;\nEGMGetId id;\n"
    'EGMSetupUC ROB_1, id, "pathCorr", "UCdevice" \\PathCorr \\APTR;\n'
    "EGMActMove id, tool1.tframe \\SampleRate:=24;\n"
    "EGMMoveL id, [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]], v100, fine, tool1 \\WObj:=part;\n"
    "EGMStop id, EGM_STOP_HOLD;\nENDPROC\nENDMODULE\n"
)
PROGRAMS: dict[str, tuple[str, Callable[[str, str], object]]] = {
    "krl": (KRL, parse_calls),
    "rapid": (RAPID, parse_egm_calls),
}
CHARACTERS = '()[],;!\\"=:#$<> \n01.-eEnax\x00ä'
DAMAGE = st.lists(
    st.tuples(st.integers(0, 600), st.integers(0, 40), st.text(alphabet=CHARACTERS, max_size=6)),
    max_size=4,
)
"""Where, how much is taken out, what is put in."""


@pytest.mark.parametrize("language", sorted(PROGRAMS))
@settings(max_examples=300, deadline=None)
@given(damage=DAMAGE)
def test_a_damaged_program_is_read_or_refused_in_one_line(language: str, damage: list[tuple[int, int, str]]) -> None:
    text, read = PROGRAMS[language]
    for at, length, new in damage:
        text = text[:at] + new + text[at + length :]
    said = ""
    try:
        read(text, "fuzz")
    except CounterflexError as fault:
        said = str(fault)
    assert "\n" not in said
