"""
Check a program before it runs
==============================

Reach, joint limits, singularities, speeds, cables, collisions: what stops a program on a robot is better found at a
desk. This page checks a program on a cell, then moves the part to a place where the program cannot run, and lets the
check say why.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/preflight.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell_file = folder / "cell-small.toml"

# %%
# The groove where the part stands
# --------------------------------
#
# One row per hazard, with the worst place of the program. ``not looked at`` names the key of the cell file that is
# missing; the value is there all the same.

checks = cf.preflight(folder / "groove.ngc", cell_file)
print(checks.group_by("verdict").len().sort("verdict"))
columns = ("check", "verdict", "value", "limit", "unit", "line")
checks.select(columns)

# %%
# What is not looked at
# ---------------------

for row in checks.filter(pl.col("verdict") == "not looked at").iter_rows(named=True):
    print(f"{row['check']}: {row['missing']}")

# %%
# The same program with the part elsewhere
# ----------------------------------------
#
# Now the part moves away from the robot, step by step. The reserve of the wrist centre before the arm is stretched
# becomes smaller, and then the program is out of reach: a row that fails, with the line and the reason, and no error
# message of the controller in the middle of a cut.

text = cell_file.read_text(encoding="utf-8")
reserve = []
for x_mm in (1350, 1750, 2150, 2550, 2950):
    moved = folder / f"part-at-{x_mm}.toml"
    moved.write_text(text.replace("x_mm = 1350", f"x_mm = {x_mm}", 1), encoding="utf-8")
    table = cf.preflight(folder / "groove.ngc", moved)
    reach = table.filter(pl.col("check") == "reach").row(0, named=True)
    failed = table.filter(pl.col("verdict") == "fail")["check"].to_list()
    row = {"x_mm": x_mm, "reserve_mm": reach["value"], "verdict": reach["verdict"], "fails": ", ".join(failed)}
    reserve.append(row)
    if reach["verdict"] == "fail":
        print(f"part at x {x_mm} mm: {reach['what']}. {reach['advice']}")
reserve_table = pl.DataFrame(reserve)
reserve_table

# %%
go.Figure(
    go.Bar(
        x=[f"{row['x_mm']} mm" for row in reserve], y=[row["reserve_mm"] for row in reserve],
        marker={"color": ["#15803d" if row["verdict"] == "ok" else "#b91c1c" for row in reserve]},
    ),
    layout={
        "title": {"text": "reserve of the reach over the place of the part"},
        "xaxis": {"title": {"text": "x of the part in the base"}},
        "yaxis": {"title": {"text": "reserve, mm"}},
    },
)  # fmt: skip
