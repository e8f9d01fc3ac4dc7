"""Ten functions for scripts and notebooks; each does what a command does, and returns what it found.

Programs and cells are given as files or as what :func:`read_cell` and :func:`compensate` return. Arguments and columns
are in shop units and named with them (``force_n``, ``deflection_x_um``). Tables are polars data frames, pictures plotly
figures. Bad input raises :class:`counterflex.core.errors.CounterflexError`: its text is one line that says what, where,
and what to do.
"""

from counterflex.api.cell import choose_posture, deflection, identify_cell, inspect_part, preflight, read_cell
from counterflex.api.compensation import compensate
from counterflex.api.machining import compare, prove, simulate

__all__ = (
    "choose_posture",
    "compare",
    "compensate",
    "deflection",
    "identify_cell",
    "inspect_part",
    "preflight",
    "prove",
    "read_cell",
    "simulate",
)
