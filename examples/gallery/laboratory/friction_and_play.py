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
from counterflex.app import examples
from counterflex.app.campaign.laboratory import measure
from counterflex.app.identification.propose import run as propose
from counterflex.app.proof.truth import make_truth
from counterflex.core.units import MM, URAD
from counterflex.files.dataset.reader import read_dataset
from counterflex.twin.truth.family import family_of

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
examples.write_all(folder / "cell.toml")
cell_file = folder / "cell-small.toml"
cell = cf.read_cell(cell_file)
truth = make_truth(cell, 7, folder / "truth.toml", family_of("mild"))

# %%
# Propose and measure
# -------------------
#
# Each axis moves back and forth by less and less, slower than it would swing: once where its weight is balanced, so
# that it crosses its play, once under load.

propose("play", 12, cell_file, folder / "fit", settings={}, seed=1)
measured = measure(folder / "fit" / "proposal.toml", cell_file, folder / "truth.toml", folder / "data", seed=1)
print(f"{measured['rows']} readings, channels {', '.join(measured['channels'])}")

# %%
# What the tracker sees
# ---------------------
#
# The first motion: the place of the target over the angle of the motor, with the straight part taken out. Forth
# and back do not lie on one line: the width of the loop is what the link stays behind by, times the lever of the
# tool.

data = read_dataset(folder / "data" / "play.toml")
q = data.channels["q_motor"].values
target = data.channels["p_tracker_target"].values
first = np.flatnonzero(data.group == data.group[0])
axis = int(np.argmax(np.ptp(q[first], axis=0)))
angle = q[first, axis] - q[first, axis].mean()
along = target[first] - target[first].mean(axis=0)
moved = along @ np.linalg.svd(along, full_matrices=False)[2][0]
loop_um = (moved - np.polyval(np.polyfit(angle, moved, 2), angle)) / MM * 1000.0
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

result = cf.identify_cell("play", [folder / "data" / "play.toml"], cell_file, folder / "found")
for figure in result["headline"]:
    print(f"{figure['text']}: {figure['value']:.3g}, before {figure['nominal']:.3g}")
figures = {figure["name"]: figure["value"] for figure in result["figures"]}
table = pl.DataFrame(
    [
        {
            "axis": k + 1,
            "half_band_urad": figures[f"axis{k + 1}_half_band_urad"],
            "half_band_sigma_urad": figures[f"axis{k + 1}_half_band_sigma_urad"],
            "true_half_band_urad": drive.dead_band_rad / URAD,
            "friction_turn_urad": figures[f"axis{k + 1}_friction_turn_urad"],
            "friction_turn_sigma_urad": figures[f"axis{k + 1}_friction_turn_sigma_urad"],
        }
        for k, drive in enumerate(truth.drives)
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
