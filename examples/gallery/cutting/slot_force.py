"""
Anatomy of a cutting force
==========================

A tooth cuts, and the next one does; each presses the tool sideways for a fraction of a revolution. The robot, whose
modes are at some 10 Hz, follows the mean of that. This page takes the force of a slot apart: single teeth, helix, the
true path of an edge, runout, and the mean that a compensation uses.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/slot_force.png"
from __future__ import annotations

import math

import numpy as np
import plotly.graph_objects as go
import polars as pl

from counterflex.core.units import DEG, MM, N_PER_MM2, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.tooth_force import tooth_forces

# %%
# The cut
# -------
#
# A slot of 6 mm depth in aluminium by an end mill of 16 mm with three teeth, 13000 rpm, 25 mm/s. The force law is
# Kienzle's: the specific force grows where the chip is thin. Its constants are those of EN AW-7075 by Berger (2013)
# with assumed ratios.

DEPTH_M = 6.0 * MM
FEED_TOOTH_M = 25.0 * MM / (13000.0 / 60.0 * 3)
kc = 780.0 * N_PER_MM2
law = KienzleLaw.from_k11(
    kc, 0.25, kr11_pa=0.35 * kc, mr=0.25, ka11_pa=0.15 * kc, ma=0.25,
    h_min_m=1.0 * UM, h_max_m=1.0 * MM, source="Berger2013, ratios assumed", status="assumed",
)  # fmt: skip
print(f"slot, D16, 3 teeth, {DEPTH_M / MM:g} mm deep, {FEED_TOOTH_M / UM:.1f} um per tooth")

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
    cutter = Cutter(16.0 * MM, flutes=3, helix_rad=helix_deg * DEG, flute_length_m=35.0 * MM, runout_m=runout_um * UM)
    teeth = tooth_forces(cutter, law, engagement_of_arc(cutter, DEPTH_M, 0.0, math.pi), FEED_TOOTH_M, trochoid=trochoid)
    x_n, y_n, z_n = (float(value) for value in teeth.mean[:3])
    rows.append(
        {
            "teeth": name, "along_n": x_n, "left_n": y_n, "up_n": z_n, "mean_n": math.hypot(x_n, y_n, z_n),
            "peak_n": teeth.peak_n, "chip_um": teeth.chip_max_m / UM,
        }
    )  # fmt: skip
    curves.append((name, teeth))
with pl.Config(tbl_cols=-1):
    print(pl.DataFrame(rows))

# %%
colours = ("#9aa3ad", "#0369a1", "#15803d", "#c2410c")
go.Figure(
    [
        go.Scatter(x=teeth.angle_rad / DEG, y=teeth.wrench_tcp[:, 1], name=name, line={"color": colour, "width": width})
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

cutter = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
closed = mean_force(cutter, law, engagement_of_arc(cutter, DEPTH_M, 0.0, math.pi)[None], FEED_TOOTH_M)
force_n = closed.wrench_tcp[0, :3]
print(f"closed form: along {force_n[0]:.1f}, left {force_n[1]:.1f}, up {force_n[2]:.1f} N")
with_runout_n = float(np.linalg.norm(curves[-1][1].mean[:3]))
print(f"mean of the teeth with runout differs by {abs(with_runout_n / np.linalg.norm(force_n) - 1.0):.1%}")

# %%
# The mean over the depth
# -----------------------
#
# The mean force grows in proportion to the depth. Over the feed it grows more slowly: a thin chip costs more per
# area, so half of the feed takes more than half of the force.

feed_um = np.linspace(5.0, 100.0, 39)
depth = np.tile(engagement_of_arc(cutter, DEPTH_M, 0.0, math.pi), (len(feed_um), 1, 1))
by_feed = mean_force(cutter, law, depth, feed_um * UM).wrench_tcp[:, :3]
go.Figure(
    [
        go.Scatter(x=feed_um, y=by_feed[:, axis], name=name, line={"width": 2.5})
        for axis, name in enumerate(("along the feed", "to its left", "out of the part"))
    ],
    layout={
        "title": {"text": "mean force of the slot over the feed"},
        "xaxis": {"title": {"text": "feed per tooth, um"}},
        "yaxis": {"title": {"text": "N"}},
    },
)
