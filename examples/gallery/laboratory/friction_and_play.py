"""
Friction and play of the axes
=============================

When an axis turns round, its link stays behind: gears have play, bearings and seals have friction. On a milled circle
that makes the marks at the quadrants. Slow reversals of single axes, seen by a tracker, tell both. This page measures
them on a simulated cell.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/friction_and_play.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell_file = folder / "cell-small.toml"
cell = cf.read_cell(cell_file)
robot = cf.SimulatedCell(cell, seed=7, family="mild")

# %%
# Propose and measure
# -------------------
#
# Each axis moves back and forth by less and less, slower than it would swing: once where its weight is balanced, so
# that it crosses its play, once under load.

cf.propose("play", 12, cell_file, folder / "fit", seed=1)
measured = robot.measure(folder / "fit", folder / "data")
print(f"{measured['rows']} readings, channels {', '.join(measured['channels'])}")

# %%
# What the tracker sees
# ---------------------
#
# The first motion: the place of the target over the angle of the motor, with the straight part taken out. Forth
# and back do not lie on one line: the width of the loop is what the link stays behind by, times the lever of the
# tool.

data = pl.read_csv(folder / "data" / "play.csv", infer_schema_length=None)
data = data.filter(pl.col("group") == data["group"][0])
q_deg = data.select("^q_motor.*$").to_numpy()
along_mm = data.select("^p_tracker_target.*$").to_numpy()
along_mm = along_mm - along_mm.mean(axis=0)
axis = int(np.argmax(np.ptp(q_deg, axis=0)))
angle = np.deg2rad(q_deg[:, axis] - q_deg[:, axis].mean())
moved_mm = along_mm @ np.linalg.svd(along_mm, full_matrices=False)[2][0]
loop_um = (moved_mm - np.polyval(np.polyfit(angle, moved_mm, 2), angle)) * 1000.0
go.Figure(
    go.Scatter(
        x=angle * 1000.0, y=loop_um, mode="markers+lines", marker={"size": 3}, line={"width": 1, "color": "#0369a1"}
    ),
    layout={
        "title": {"text": f"axis {axis + 1}: where the target is beside a smooth curve"},
        "xaxis": {"title": {"text": "angle of the motor, mrad"}},
        "yaxis": {"title": {"text": "um"}},
    },
)

# %%
# Identify
# --------
#
# Without separate data, parts of the motions are held out in turn. The error has the noise of the tracker in it.
#
# The torsion compliance of the axes turns lost motion into friction. In this cell it is near to what the cell file
# says; where it is not, friction of the link exceeds that of link and motor together, and no value is written:
# identify the stiffness first.

result = cf.identify("play", [folder / "data" / "play.toml"], cell_file, folder / "found")
for figure in result.summary["headline"]:
    print(f"{figure['text']}: {figure['value']:.3g}, before {figure['nominal']:.3g}")
figures = result.figures
true = dict(robot.table.select("name", "value").iter_rows())
table = pl.DataFrame(
    [
        {
            "axis": k + 1,
            "half_band_urad": figures[f"axis{k + 1}_half_band_urad"],
            "half_band_sigma_urad": figures[f"axis{k + 1}_half_band_sigma_urad"],
            "true_half_band_urad": true[f"axis{k + 1}_half_band"],
            "friction_turn_urad": figures[f"axis{k + 1}_friction_turn_urad"],
            "friction_turn_sigma_urad": figures[f"axis{k + 1}_friction_turn_sigma_urad"],
        }
        for k in range(6)
    ]
)
table

# %%
# Half of the dead band of each axis, with twice its standard deviation; the crosses are true.

go.Figure(
    [
        go.Scatter(
            x=table["axis"], y=table["half_band_urad"], name="identified, 95 %", mode="markers",
            marker={"color": "#0369a1", "size": 10},
            error_y={"type": "data", "array": 1.96 * table["half_band_sigma_urad"], "thickness": 2.5},
        ),
        go.Scatter(
            x=table["axis"], y=table["true_half_band_urad"], name="true", mode="markers",
            marker={"color": "#111827", "symbol": "x", "size": 10},
        ),
    ],
    layout={
        "title": {"text": "play of the axes"},
        "xaxis": {"title": {"text": "axis"}, "dtick": 1},
        "yaxis": {"title": {"text": "half dead band, urad"}, "rangemode": "tozero"},
    },
)  # fmt: skip

# %%
# ``found/cell.toml`` has ``[[robot.play]]`` of every axis that moved, and plans use it. How the motions are chosen,
# and what the model leaves out, stands in :doc:`/identify/play`.
