"""The words of TwinCAT NC I as the reader asks for them, from the table of statements."""

from __future__ import annotations

from typing import Final

from counterflex.integrations.beckhoff.language.word_table import CODES
from counterflex.programs.gcode.sinumerik.words import WordTable
from counterflex.programs.statement_table import Treatment

TWINCAT: Final = WordTable(
    dialect="TwinCAT",
    group={code.word: code.group for code in CODES if code.group.islower()},
    carried=frozenset(("FCONST", "FLIN")),
    carried_values=frozenset(("H", "D")),
    refused={code.word: (code.reason, code.remedy) for code in CODES if code.treatment is Treatment.REFUSED},
    m_codes=frozenset(range(160)) - {17},
    cycles=(),
)
"""M functions are defined by the machine builder in the channel; those of counterflex keep their usual meaning."""
