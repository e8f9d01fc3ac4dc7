"""
Joint compliances from cable pulls
==================================

A cable, a pulley, a load of 750 N and a tracker: pull at the tool in some poses, and the compliance of every
elastic element of the cell follows, as far as the pulls tell it. This page does the whole of it on a simulated cell
whose true compliances are known to the simulation only, so that the result can be judged at the end: do the intervals
hold what they promise?

In your laboratory the step *Measure* is yours. The proposal comes with a form to fill, ``stiffness.csv``.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/cable_pulls.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell_file = folder / "cell-small.toml"
cell = cf.read_cell(cell_file)

# %%
# The robot on the test bench
# ---------------------------
#
# A simulated cell of seed 7. From here on the identification sees nothing of it but the readings.

robot = cf.SimulatedCell(cell, seed=7, family="wide")

# %%
# Where the tracker stands
# ------------------------
#
# The tracker reads displacements in its own axes. Eight poses of the robot, seen by the tracker, tell how these lie to
# the base; the recipe ``tracker-frame`` writes that into a new cell file, which the pulls then begin with.

cf.propose("tracker-frame", 8, cell_file, folder / "poses", seed=1)
robot.measure(folder / "poses", folder / "seen")
frame = cf.identify("tracker-frame", [folder / "seen" / "tracker-frame.toml"], cell_file, folder / "tracked")
cell_file = folder / "tracked" / "cell.toml"
print("; ".join(f"{figure['text']}: {figure['value']:.3g}" for figure in frame.summary["headline"]))

# %%
# Propose
# -------
#
# Poses and cable directions are chosen so that the deflection near the part becomes certain. The proposal says
# beforehand which standard deviation to expect of every compliance: here of the eight that will be known best and of
# the three that will not.

proposed = cf.propose("stiffness", 20, cell_file, folder / "fit", seed=1)
cf.propose("stiffness", 8, cell_file, folder / "unseen", seed=101)
expected = pl.DataFrame(proposed["expected"]).filter(pl.col("unit") == "urad/kNm").sort("sigma")
print(pl.concat([expected.head(8), expected.tail(3)]))

# %%
# Measure
# -------
#
# Each pull: read, load, move every axis back by 0.04 deg and return slowly so that friction cancels, read again. 8
# further pulls, in other poses, are never fitted: they judge the result.

measured = robot.measure(folder / "fit", folder / "data")
robot.measure(folder / "unseen", folder / "holdout")
print(f"{measured['rows']} pulls, channels {', '.join(measured['channels'])}")

# %%
# Identify
# --------
#
# The standard deviation of the values in the cell file is stated as 50 %: they come from a catalogue. The first
# number that counts is the deflection of held-out pulls that is *not* explained, before and after.

result = cf.identify(
    "stiffness",
    [folder / "data" / "stiffness.toml"],
    cell_file,
    folder / "found",
    holdout=[folder / "holdout" / "stiffness.toml"],
    settings={"prior": 0.5, "regions": False},
)
for figure in result.summary["headline"]:
    print(f"{figure['text']}: {figure['value']:.3g}, with the cell file {figure['nominal']:.3g}")

# %%
# Do the intervals hold?
# ----------------------
#
# Only a simulation can answer that: the dark crosses are the true values. A bar that the data have not made shorter
# than the grey one is a compliance that these pulls do not see. It says so, and keeps the value of the catalogue.

true = robot.table.rename({"value": "true"}).drop("unit")
table = result.table.filter(pl.col("prior_sigma").is_not_null(), pl.col("low").is_not_null()).join(true, on="name")
table = table.select("label", "unit", "nominal", "value", "low", "high", "seen", "true")
inside = table.select(pl.col("true").is_between(pl.col("low"), pl.col("high"))).to_series()
print(f"{inside.sum()} of {len(inside)} true values lie in their 95 % interval")
table.filter(pl.col("seen") == "determined").drop("unit", "seen")

# %%
nominal = table["nominal"]
go.Figure(
    [
        go.Scatter(
            y=table["label"], x=[100.0] * len(table), name="catalogue, 95 % of the prior", mode="markers",
            marker={"color": "#9aa3ad", "symbol": "line-ns-open", "size": 9},
            error_x={"type": "constant", "value": 98.0, "color": "#d1d5db", "thickness": 9, "width": 0},
        ),
        go.Scatter(
            y=table["label"], x=100.0 * table["value"] / nominal, name="identified, 95 %", mode="markers",
            marker={"color": "#0369a1", "size": 9},
            error_x={
                "type": "data", "symmetric": False, "color": "#0369a1", "thickness": 2.5,
                "array": 100.0 * (table["high"] - table["value"]) / nominal,
                "arrayminus": 100.0 * (table["value"] - table["low"]) / nominal,
            },
        ),
        go.Scatter(
            y=table["label"], x=100.0 * table["true"] / nominal, name="true", mode="markers",
            marker={"color": "#111827", "symbol": "x", "size": 9},
        ),
    ],
    layout={
        "title": {"text": "compliances, in percent of the catalogue"},
        "height": 120 + 26 * len(table),
        "margin": {"l": 150},
        "xaxis": {"title": {"text": "percent"}, "range": [0, 260]},
        "legend": {"orientation": "h", "y": 1.04, "yanchor": "bottom"},
    },
)  # fmt: skip

# %%
# The new cell file is ``found/cell.toml``; ``found/report.html`` has the residuals of every pull. More about
# procedure and friction stands in the reference of the recipe, :doc:`/identify/stiffness`.
