"""
Anatomy of a cutting force
==========================

A tooth cuts, and the next one does; each presses the tool sideways for a fraction of a revolution. The robot, whose
modes are at some 10 Hz, follows the mean of that. This page takes the force of a slot apart: single teeth, helix, the
true path of an edge, runout, and the mean that a compensation uses.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/slot_force.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
cell = cf.read_cell(cf.examples(Path(scratch.name)) / "cell-small.toml")

# %%
# The cut
# -------
#
# A slot of 6 mm depth in aluminium by T1 of the demonstration cell, an end mill of 16 mm with three teeth, 13000 rpm,
# 25 mm/s. The force law is Kienzle's: the specific force grows where the chip is thin. Its constants are those of
# EN AW-7075 by Berger (2013) with assumed ratios.

DEPTH_MM = 6.0
FEED_TOOTH_UM = 25.0 / (13000.0 / 60.0 * 3) * 1000.0
print(cell)
print(f"slot {DEPTH_MM:g} mm deep, {FEED_TOOTH_UM:.1f} um per tooth")

# %%
# One revolution
# --------------
#
# x is along the feed, y to its left. Straight teeth on a circular path first, then a helix of 30 deg, then the same
# with a runout of 10 um (the axis of the tool is that far beside the axis of the spindle): one tooth cuts more, the
# next less.

CASES = (
    ("straight teeth, circular path", 0.0, 0.0, False),
    ("helix 30 deg", 30.0, 0.0, False),
    ("helix 30 deg, true edge path", 30.0, 0.0, True),
    ("the same with 10 um runout", 30.0, 10.0, True),
)
rows, curves = [], []
for name, helix_deg, runout_um, trochoid in CASES:
    teeth = cf.forces(
        cell, depth_mm=DEPTH_MM, feed_per_tooth_um=FEED_TOOTH_UM, revolution=True,
        helix_deg=helix_deg, runout_um=runout_um, trochoid=trochoid,
    )  # fmt: skip
    mean = teeth.select("along_n", "left_n", "up_n").mean().row(0, named=True)
    rows.append({"teeth": name, **mean, "mean_n": float(np.linalg.norm(list(mean.values()))),
                 "peak_n": teeth["force_n"].max()})  # fmt: skip
    curves.append((name, teeth))
with pl.Config(tbl_cols=-1):
    print(pl.DataFrame(rows))

# %%
colours = ("#9aa3ad", "#0369a1", "#15803d", "#c2410c")
go.Figure(
    [
        go.Scatter(x=teeth["angle_deg"], y=teeth["left_n"], name=name, line={"color": colour, "width": width})
        for (name, teeth), colour, width in zip(curves, colours, (1.5, 1.5, 2, 3), strict=True)
        if "true" not in name
    ],
    layout={
        "title": {"text": "force across the feed over one revolution"},
        "xaxis": {"title": {"text": "rotation of the spindle, deg"}, "dtick": 60},
        "yaxis": {"title": {"text": "force to the left of the feed, N"}},
        "legend": {"orientation": "h", "y": -0.25},
    },
)

# %%
# What the robot answers
# ----------------------
#
# Three teeth at 13000 rpm pass 650 times a second, sixty times faster than the arm swings. It answers the mean, for
# which there is a closed form; helix and runout hardly change it. That is why a plan needs no simulation of single
# teeth.

closed = cf.forces(cell, depth_mm=DEPTH_MM, feed_per_tooth_um=FEED_TOOTH_UM, helix_deg=0.0).row(0, named=True)
print(f"closed form: along {closed['along_n']:.1f}, left {closed['left_n']:.1f}, up {closed['up_n']:.1f} N")
print(f"mean of the teeth with runout differs by {abs(rows[-1]['mean_n'] / closed['force_n'] - 1.0):.1%}")

# %%
# The mean over the depth
# -----------------------
#
# The mean force grows in proportion to the depth. Over the feed it grows more slowly: a thin chip costs more per
# area, so half of the feed takes more than half of the force.

feed_um = np.linspace(5.0, 100.0, 39)
by_feed = cf.forces(cell, depth_mm=DEPTH_MM, feed_per_tooth_um=feed_um)
go.Figure(
    [
        go.Scatter(x=feed_um, y=by_feed[f"{axis}_n"], name=name, line={"width": 2.5})
        for axis, name in (("along", "along the feed"), ("left", "to its left"), ("up", "out of the part"))
    ],
    layout={
        "title": {"text": "mean force of the slot over the feed"},
        "xaxis": {"title": {"text": "feed per tooth, um"}},
        "yaxis": {"title": {"text": "N"}},
    },
)
