"""Where sensor correction is switched on and off in a KRL program: around its path, and nothing else."""

from __future__ import annotations

import re

import pytest

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.rsi import check_path, with_correction
from counterflex.integrations.kuka.language.rsi_switching import RsiSwitching

HEAD = ["&ACCESS RVP", "&REL 1", "DEF groove( )", "$TOOL=TOOL_DATA[1]"]
TAIL = ["$VEL.CP=0.025", "LIN {X 0,Y 0,Z 5,A 0,B 90,C 0}", "LIN {X 9,Y 0,Z 5,A 0,B 90,C 0} C_DIS", "END", ""]
SWITCHING = RsiSwitching("counterflex.rsi", (), 4, 2, 1, 3, 4, 60.0, 5.0)


@pytest.mark.parametrize(
    "approach",
    [
        ["PTP XHOME"],
        ["PTP XHOME", "PTP XSTART"],
        ["PTP XHOME", "; on the way", "PTP XOVER C_PTP", "$ACC.CP=1.0", "ptp XSTART"],
    ],
    ids=["one", "two", "three"],
)
def test_it_is_switched_on_behind_the_last_ptp(approach: list[str]) -> None:
    """A point-to-point motion under correction is refused by the controller, or moves the arm with it."""
    lines = with_correction("\n".join([*HEAD, *approach, *TAIL]), SWITCHING, "groove.src").splitlines()
    code = [line.split(";")[0] for line in lines]
    ptp = [i for i, line in enumerate(code) if re.match(r"\s*PTP\b", line, re.IGNORECASE)]
    on = [i for i, line in enumerate(code) if re.search(r"\bRSI_(CREATE|ON)\s*\(", line, re.IGNORECASE)]
    path = [i for i, line in enumerate(code) if re.match(r"\s*LIN\b", line)]
    off = [i for i, line in enumerate(code) if re.search(r"\bRSI_(OFF|DELETE)\s*\(", line, re.IGNORECASE)]
    assert len(ptp) >= len(approach) - ("; on the way" in approach) - ("$ACC.CP=1.0" in approach)
    assert len(on) == 2
    assert max(ptp) < min(on) < max(on) < min(path)
    assert max(path) < min(off)


@pytest.mark.parametrize(
    "path",
    [
        TAIL[1:-2],
        ["groove_001( )", "groove_002( )"],
        ["groove_001( )", "SPINDLE_FASTER( )", *TAIL[1:-2]],
        ["own( )"],
    ],
    ids=["one file", "parts", "both", "a part by name"],
)
@pytest.mark.parametrize(
    "behind",
    [["COOLANT_OFF( )", "HALT ; stop the spindle, then press start"], ["HALT", "$OUT[17]=FALSE", "SPINDLE_OFF( )"]],
    ids=["by hand", "M0"],
)
def test_the_correction_is_gone_before_a_person_is_asked_for_something(path: list[str], behind: list[str]) -> None:
    """Else the operator stands before a robot that a sensor moves."""
    start = "HALT ; start the spindle, 9000 rpm, then press start"
    text = "\n".join([*HEAD, "PTP XSTART", start, "COOLANT( )", *path, *behind, "END", ""])
    lines = with_correction(text, SWITCHING, "groove.src", ["own"]).splitlines()
    on = lines.index("cfr=RSI_ON(#ABSOLUTE,#IPO_FAST)")
    off, deleted = lines.index("cfr=RSI_OFF()"), lines.index("cfr=RSI_DELETE(cfid)")
    first, last = lines.index(path[0]), lines.index(path[-1])
    assert lines.index(start) < lines.index("COOLANT( )") < on < first <= last < lines.index("$SEN_PREA[2]=0.0", first)
    assert lines.index("$SEN_PREA[2]=0.0", first) < lines.index("WHILE NOT (CF_ZERO( ))") < off < deleted
    assert deleted < lines.index(behind[0], deleted) <= lines.index("END") - len(behind)
    assert not any(re.match("HALT$", line) for line in lines[first:last])


def test_a_stop_for_a_person_on_the_path_is_refused() -> None:
    text = "\n".join([*HEAD, "PTP XSTART", TAIL[1], "HALT", *TAIL[1:]])
    with pytest.raises(ProgramError, match=r"groove.src:7: the program stops for the operator on its path.*got HALT"):
        with_correction(text, SWITCHING, "groove.src")
    part = ["DEF groove_001( )", TAIL[1], "HALT ; stop the spindle, then press start", "END"]
    with pytest.raises(ProgramError, match=r"groove_001.src:3: the program stops for the operator"):
        check_path(part, "groove_001.src")
