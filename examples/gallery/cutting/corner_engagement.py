"""
What happens in an inside corner?
=================================

Tools break in corners, and robots bend there most. The reason is the engagement: in an inside corner the cutter is
suddenly surrounded by material. This page cuts a corner into a blank by the removal simulation and reads off what the
cutter meets.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/corner_engagement.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
cell = cf.read_cell(folder / "cell-small.toml")

# %%
# The program
# -----------
#
# An L-shaped slot, 4 mm deep, then a second pass that takes 4 mm more off its outer wall. The second pass is the one
# to look at.

PROGRAM = """
G17 G21 G54 G90
M6 T1
M3 S13000
G0 Z60
G0 X-10 Y26
G0 Z42
G1 Z36 F3000
G1 X34 F1500
G1 Y70
G0 Z60
G0 X-10 Y22
G0 Z42
G1 Z36 F3000
G1 X38 F1500 (towards the corner)
G1 Y70 (away from it)
G0 Z60
M30
""".lstrip()
file = folder / "corner.ngc"
file.write_text(PROGRAM, encoding="utf-8")
towards = next(n for n, text in enumerate(PROGRAM.splitlines(), start=1) if "towards" in text)

# %%
# Cutting it
# ----------
#
# The stock is a height map. Every segment of the path removes the volume that the cutter sweeps, and books at which
# angle of the cutter it was removed. Averaged over a millimetre of path that gives entry and exit angle, width and
# area of the cut.

seen = cf.engagement(file, cell, every_mm=1.0)
corner = seen.filter(
    pl.col("line") >= towards, pl.col("volume_mm3") > 0.0, pl.col("x_mm") > 20.0, pl.col("y_mm") < 40.0
).with_columns(from_corner_mm=(pl.col("x_mm") - 38.0) + (pl.col("y_mm") - 22.0))
area_mm2 = corner["area_mm2"].to_numpy()
before_mm2 = float(np.median(area_mm2[corner["from_corner_mm"].to_numpy() < -12.0]))
print(corner.filter(pl.col("from_corner_mm").is_between(-6.0, 6.0)))
print(f"chip area {before_mm2:.1f} mm2 along the wall, {area_mm2.max():.1f} mm2 in the corner")

# %%
# Along the wall the cutter takes its 4 mm; in the corner several times that, for a few millimetres of path. The force
# grows with the area, and the arm bends by as much more: a correction that is constant along a line leaves an error
# of just that length.

go.Figure(
    [
        go.Scatter(
            x=corner["from_corner_mm"],
            y=corner["area_mm2"],
            name="chip area, mm2",
            line={"color": "#c2410c", "width": 3},
        ),
        go.Scatter(
            x=corner["from_corner_mm"], y=corner["width_mm"], name="width of cut, mm", line={"color": "#0369a1"}
        ),
    ],
    layout={
        "title": {"text": "second pass through the corner"},
        "xaxis": {"title": {"text": "way from the corner, mm"}},
        "yaxis": {"rangemode": "tozero"},
    },
)

# %%
# The arc of engagement: between entry and exit the edges cut. 180 deg would be a full slot.

go.Figure(
    [
        go.Scatter(x=corner["from_corner_mm"], y=corner["entry_deg"], name="entry, deg", line={"color": "#15803d"}),
        go.Scatter(
            x=corner["from_corner_mm"],
            y=corner["exit_deg"],
            name="exit, deg",
            line={"color": "#9333ea"},
            fill="tonexty",
        ),
    ],
    layout={
        "title": {"text": "angles at which an edge enters and leaves the material"},
        "xaxis": {"title": {"text": "way from the corner, mm"}},
        "yaxis": {"title": {"text": "immersion angle, deg"}, "range": [0, 185], "dtick": 45},
    },
)
