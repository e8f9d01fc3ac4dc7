"""Which codes and words of TwinCAT NC I the reader knows, by group, and why it refuses the others.

Source: Beckhoff, TF5100 TwinCAT 3 NC I, "Interpreter (DIN 66025/G-Code)" and "Command overview".
"""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.gcode.sinumerik.words import WordTable

_CAM: Final = "Let the CAM system write the tool-centre path"
_UNROLLED: Final = "Post the program without subprograms, jumps and calculations"
_UNSURE: Final = "Post G2 or G3 with I J K or U"
TWINCAT: Final = WordTable(
    dialect="TwinCAT",
    group={
        **dict.fromkeys(("G0", "G1", "G2", "G3"), "motion"),
        "G4": "dwell",
        **dict.fromkeys(("G17", "G18", "G19"), "plane"),
        **dict.fromkeys(("G70", "G71"), "unit"),
        **dict.fromkeys(("G90", "G91"), "distance"),
        "G40": "cutter radius",
        **dict.fromkeys(("G53", "G54", "G55", "G56", "G57"), "work offset"),
        "G60": "path control",
        "G9": "exact stop once",
    },
    carried=frozenset(("FCONST", "FLIN")),
    carried_values=frozenset(("H", "D")),
    refused={
        **dict.fromkeys(("G41", "G42"), ("cutter radius compensation depends on the control's tool table", _CAM)),
        **dict.fromkeys(("G58", "G59"), ("the second programmable offset is not read", "Write the targets themselves")),
        "G74": ("a reference point of the machine is not known here", "Retract with a plain G0"),
        "G31": ("deleting the distance to go is not read", "Post the path without it"),
        **dict.fromkeys(("CIP", "G303"), ("the arc through a point is not read", _UNSURE)),
        "B": ("a radius B is not told from a rotary axis B", "Write the radius as U"),
        **dict.fromkeys(
            ("ROT", "AROT", "MIRROR", "ZDS", "CLOCKDB"),
            ("this frame is not read", "Post without frames of the control"),
        ),
        **dict.fromkeys(
            re.findall(r"\w+", "L IF ELSE ELSIF ENDIF FOR WHILE REPEAT SWITCH WHEN GOTO SYNC CALL"),
            ("jumps, loops, subprograms and variables are not read", _UNROLLED),
        ),
    },
    m_codes=frozenset(range(160)) - {17},
    cycles=(),
)
"""M functions are defined by the machine builder in the channel; those of counterflex keep their usual meaning."""
