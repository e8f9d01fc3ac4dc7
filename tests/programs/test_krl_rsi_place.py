"""Where sensor correction is switched on in a KRL program: behind the last PTP, before the first path motion."""

from __future__ import annotations

import re

import pytest

from counterflex.programs.krl_rsi import RsiSwitching, with_correction

HEAD = ["&ACCESS RVP", "&REL 1", "DEF groove( )", "$TOOL=TOOL_DATA[1]"]
TAIL = ["$VEL.CP=0.025", "LIN {X 0,Y 0,Z 5,A 0,B 90,C 0}", "LIN {X 9,Y 0,Z 5,A 0,B 90,C 0} C_DIS", "END", ""]


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
    switching = RsiSwitching("counterflex.rsi", (), 4, 2, 1, 3, 4, 60.0, 5.0)
    lines = with_correction("\n".join([*HEAD, *approach, *TAIL]), switching, "groove.src").splitlines()
    code = [line.split(";")[0] for line in lines]
    ptp = [i for i, line in enumerate(code) if re.match(r"\s*PTP\b", line, re.IGNORECASE)]
    on = [i for i, line in enumerate(code) if re.search(r"\bRSI_(CREATE|ON)\s*\(", line, re.IGNORECASE)]
    path = [i for i, line in enumerate(code) if re.match(r"\s*LIN\b", line)]
    off = [i for i, line in enumerate(code) if re.search(r"\bRSI_(OFF|DELETE)\s*\(", line, re.IGNORECASE)]
    assert len(ptp) >= len(approach) - ("; on the way" in approach) - ("$ACC.CP=1.0" in approach)
    assert len(on) == 2
    assert max(ptp) < min(on) < max(on) < min(path)
    assert max(path) < min(off)
