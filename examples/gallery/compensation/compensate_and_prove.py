"""
Compensate a groove and prove it
================================

From a program to a program: predict how far the robot bends along a groove, write the program compensated, and
machine both on a simulated cell that the planner does not know. The simulated cell is another robot than the model:
its compliances, masses, friction, play and force constants are off by what is usual when only a catalogue is known.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/compensate_and_prove.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell = cf.read_cell(folder / "cell-small.toml")
program = folder / "groove.ngc"
print(program.read_text(encoding="utf-8"))

# %%
# The plan
# --------
#
# ``cf.compensate`` cuts the program into the blank, computes the force, bends the arm by it, and writes the program
# so that the bent arm follows the programmed path. What it prints first are the figures to plan with: the median of the
# path error over all that is not known of the cell, and the range that nine of ten such cells lie in. The model without
# its unknowns stands below.

plan = cf.compensate(program, cell)
print(plan)
largest = plan.table.select(pl.col("correction_y_um").abs().max()).item()
print(f"largest correction across the groove: {largest:.0f} um")
plan.plot("along")

# %%
# The deflection is not constant: it grows while the cutter enters, and changes along the groove as the posture
# changes.

plan.plot("map")

# %%
# The compensated program is in the same language, with points added where the correction changes.

name, text = next(iter(plan.files.items()))
moves = [line for line in text.splitlines() if line.startswith("G1 X")]
print(f"{name}: {len(moves)} moves along the groove instead of 1")
print("\n".join(moves[:6]))

# %%
# Both programs on a simulated cell
# ---------------------------------
#
# Seed 7 of the family ``wide`` is one robot of which only catalogue and handbook are known. Seeds below 1000 are for
# trying; figures that counterflex publishes come from others.

before = cf.simulate(program, cell, seed=7, family="wide")
after = cf.simulate(plan, cell, seed=7, family="wide")
judged = cf.compare(before, after)
print(judged.table.filter(pl.col("figure").str.starts_with("path.")))
judged.plot("path")

# %%
# What remains is the error of the prediction: of this robot only published values are known. With :ref:`its own
# compliances <sphx_glr_gallery_laboratory_cable_pulls.py>` and :ref:`force constants
# <sphx_glr_gallery_laboratory_cutting_constants.py>` it becomes smaller.
#
# The surface of both parts, from above, as a coordinate measuring machine would colour it:

judged.plot("map")

# %%
judged.plot("histogram")
