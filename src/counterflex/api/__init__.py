"""Classes and functions for scripts and notebooks; each does what a command does, with the same figures.

Arguments and columns are in shop units and named with them (``force_n``, ``deflection_x_um``). Cells and programs are
given as files or as what :func:`~counterflex.api.cell.read_cell` and :func:`~counterflex.api.program.read_program`
return. Results are classes with ``table`` (polars), ``summary`` (plain values), ``plot`` (plotly) and ``save``. Bad
input raises :class:`counterflex.core.errors.CounterflexError`: its text is one line that says what, where, and what to
do.
"""
