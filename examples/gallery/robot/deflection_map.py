"""
How far does the arm bend, and where?
=====================================

A milling robot of 300 kg payload is much softer than a machine tool. How soft it is depends on where the
tool stands and on where the force comes from. This page asks the elastic model of a cell three questions: how far the
tool moves under the same force at different places of the part, in which direction it is soft, and which elements of
the arm make the deflection.

The cell is the demonstration of counterflex: a KUKA KR 300 R2500 ultra with a spindle across the flange, in front of
it a blank of 200 x 150 x 40 mm. For a cell of your own, read its cell file instead.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/deflection_map.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell = cf.read_cell(folder / "cell.toml")
print(cell)

# %%
# The same force everywhere
# -------------------------
#
# 300 N along y of the part is what an end mill of 16 mm needs in a full slot. ``cf.deflection`` takes tool tips in mm
# and forces in N, both in the part frame, and returns a table in um.

x_mm, y_mm = np.linspace(0.0, 200.0, 21), np.linspace(0.0, 150.0, 16)
places = [[x, y, 40.0] for y in y_mm for x in x_mm]
bent = cf.deflection(cell, at_mm=places, force_n=[0.0, 300.0, 0.0]).with_columns(
    pl.sum_horizontal(pl.col(f"deflection_{axis}_um") ** 2 for axis in "xyz").sqrt().alias("deflection_um")
)
size_um = bent["deflection_um"].to_numpy().reshape(len(y_mm), len(x_mm))
apart = size_um.max() / size_um.min() - 1.0
print(f"from {size_um.min():.0f} to {size_um.max():.0f} um: {apart:.0%} apart")
print(bent.filter(pl.col("x_mm").is_in([0.0, 100.0, 200.0]) & pl.col("y_mm").is_in([0.0, 150.0])))

# %%
# One number for "the stiffness of the robot" would be wrong by that much on this small blank alone; a compensation
# computes the deflection at every point of the path.

go.Figure(
    go.Contour(
        x=x_mm, y=y_mm, z=size_um, colorscale="Viridis", colorbar={"title": {"text": "um"}},
        contours={"showlabels": True, "labelfont": {"color": "white"}},
        hovertemplate="x %{x:.0f}, y %{y:.0f} mm: %{z:.0f} um<extra></extra>",
    ),
    layout={
        "title": {"text": "deflection of the tool under 300 N along y"},
        "xaxis": {"title": {"text": "x of the part, mm"}, "constrain": "domain"},
        "yaxis": {"title": {"text": "y of the part, mm"}, "scaleanchor": "x", "constrain": "domain"},
    },
)  # fmt: skip

# %%
# The arm bends under its own weight too, by more than any cutting force; but a part frame that was measured by
# touching the part with the robot contains that. What remains is how much the sag varies over the part.

sag_um = bent.select("^sag_._um$").to_numpy()
varies_um = np.linalg.norm(sag_um - sag_um.mean(axis=0), axis=1).max()
print(f"sag {np.linalg.norm(sag_um, axis=1).mean():.0f} um; over the part it varies by {varies_um:.0f} um")

# %%
# The same place, forces all around
# ---------------------------------
#
# In the middle of the blank the force now turns around the tool. The further the curve is from the centre, the softer
# the arm is against a force from there. The second curve is what the force moves across itself: an arm yields
# sideways too, so that a force along the feed makes a slot run off its line.

angle_deg = np.arange(0.0, 360.0, 5.0)
direction = np.stack([np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg)), np.zeros(len(angle_deg))], axis=1)
around = cf.deflection(cell, at_mm=np.tile([100.0, 75.0, 40.0], (len(direction), 1)), force_n=300.0 * direction)
moved_um = around.select("^deflection_._um$").to_numpy()
along_um = np.sum(moved_um * direction, axis=1)
across_um = np.linalg.norm(moved_um - along_um[:, None] * direction, axis=1)
print(f"along the force: {along_um.min():.0f} to {along_um.max():.0f} um; across it: up to {across_um.max():.0f} um")

go.Figure(
    [
        go.Scatterpolar(theta=angle_deg, r=along_um, name="along the force, um", line={"width": 3}),
        go.Scatterpolar(theta=angle_deg, r=across_um, name="across it, um", line={"dash": "dash"}),
    ],
    layout={"title": {"text": "deflection under 300 N from all sides"}, "height": 460},
)

# %%
# Which elements bend
# -------------------
#
# The model is a chain of elastic elements: the torsion of each gear, the tilting of each bearing, links, force
# sensor, spindle holder. ``by_element`` returns what each contributes.

parts = cf.deflection(cell, at_mm=[100.0, 75.0, 40.0], force_n=[0.0, 300.0, 0.0], by_element=True)
whole_um = parts.select("^deflection_._um$").sum().to_numpy()[0]
length_um = float(np.linalg.norm(whole_um))
share = parts.select(
    "element", um=pl.col("share") * length_um, percent=100.0 * pl.col("share")
).filter(pl.col("percent").abs() >= 1.0)  # fmt: skip
print(share.sort("percent", descending=True))

go.Figure(
    go.Bar(x=share["element"].to_list(), y=share["um"].to_list(), marker={"color": "#0369a1"}),
    layout={
        "title": {"text": f"what makes the {length_um:.0f} um in the middle of the blank"},
        "yaxis": {"title": {"text": "um, along the deflection"}},
    },
)

# %%
# The element with the longest bar is the one to measure first: :ref:`cable pulls
# <sphx_glr_gallery_laboratory_cable_pulls.py>` tell the compliance of each.
