"""Compensate a groove from Python, machine it on a simulated cell before and after, and print what became of it."""

from __future__ import annotations

from pathlib import Path

import polars as pl

import counterflex as cf

HERE = Path(__file__).parent


def main() -> None:
    """Ask the cell how far it bends, compensate a program, try both programs on the simulated cell, and compare."""
    cell = cf.read_cell(HERE / "cells" / "kr300_d16_small.toml")
    program = HERE / "programs" / "groove.ngc"

    bent = cf.deflection(cell, at_mm=[[0.0, 15.0, 34.0], [60.0, 15.0, 34.0]], force_n=[0.0, 300.0, 0.0])
    print("displacement of the tool by 300 N across the groove, at both ends, um:")
    print(bent.select(pl.col("x_mm"), pl.col("^deflection_._um$").round(0)))

    plan = cf.compensate(program, cell)
    largest = plan.table.select(pl.col("correction_y_um").abs().max()).item()
    print(f"largest correction across the groove: {largest:.0f} um")

    before = cf.simulate(program, cell, seed=7, family="wide")
    after = cf.simulate(plan, cell, seed=7, family="wide")
    found = cf.compare(before, after)
    print(found.table.filter(pl.col("figure").str.starts_with("path.")))
    print(f"pictures: {len(plan.plot('map').data)} traces of the plan, {len(found.plot('path').data)} of the error")


if __name__ == "__main__":
    main()
