"""
How does the arm swing? Modes and a tap test
============================================

An arm with a spindle swings at some 10 Hz. That limits how fast a feed may change, and it is where low-frequency
chatter comes from. This page computes the modes of a cell, says how well they are known, and corrects the masses of
the model by a tap test: hit the tip of the tool with an instrumented hammer and measure how it moves.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/modes_and_tap_test.png"
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
joints_deg = [0.0, -90.0, 110.0, 0.0, 40.0, 0.0]

# %%
# Modes from the cell file
# ------------------------
#
# Each row is a natural frequency with the interval that nine of ten robots with these data lie in: masses come from
# the catalogue and are assumed to some 15 %, compliances to 35 %. The last column names the springs that bend most.

found = cf.modes(cell, joints_deg)
print(found)
found.table

# %%
# A tap test
# ----------
#
# Your file comes here: columns ``frequency_hz,force,motion,real_um_n,imag_um_n`` in base axes. To have one, we tap a
# robot that differs from the cell file as real ones do: a spindle 20 % heavier, an arm 25 % heavier, compliances 10 %
# larger, and 3 % of noise in the response.

heavier = {"spindle": 1.2, "axis3": 1.15, "link_arm": 1.25}
hz = np.arange(3.0, 40.5, 0.5)
true = found.response(hz, mass_factors=heavier, factor=1.1, damping_s=2e-3)
noise = np.random.default_rng(1)
size = 0.03 * np.hypot(true["real_um_n"], true["imag_um_n"])
tapped = true.with_columns(
    real_um_n=true["real_um_n"] + size * noise.normal(size=len(true)),
    imag_um_n=true["imag_um_n"] + size * noise.normal(size=len(true)),
)
tap_file = folder / "tap_test.csv"
tapped.select(frequency_hz="hz", force="axis", motion="axis", real_um_n="real_um_n", imag_um_n="imag_um_n").write_csv(
    tap_file
)
print("\n".join(tap_file.read_text(encoding="utf-8").splitlines()[:4]))

# %%
# What the test says of the masses
# --------------------------------
#
# The fit starts from the cell file with what is known of each value, and moves what the data see. A mass that the
# test does not see keeps its value and says so.

fit = found.compare(tap_file)
masses = pl.DataFrame(fit["masses"])
truth = [row["stated_kg"] * heavier.get(row["body"], 1.0) for row in fit["masses"]]
print(masses.with_columns(true_kg=pl.Series(truth)))
print(f"all stiffnesses x {fit['stiffness_factor']:.3f} (true: {1.0 / 1.1:.3f})")
print(f"agreement (FRAC) {fit['frac_before']:.3f} before, {fit['frac_after']:.3f} after")

# %%
# The response along y of the base, measured and computed. A peak that stands at the wrong frequency is a mass or a
# stiffness; one of the wrong height is damping.

fitted = found.response(
    hz,
    mass_factors={row["body"]: row["fitted_kg"] / row["stated_kg"] for row in fit["masses"]},
    factor=1.0 / fit["stiffness_factor"],
    damping_s=fit["damping_s_after"],
)
curves = (
    ("tap test", tapped, {"mode": "markers", "marker": {"color": "#111827", "size": 6}}),
    ("cell file", found.response(hz), {"line": {"color": "#c2410c", "dash": "dash"}}),
    ("fitted", fitted, {"line": {"color": "#0369a1", "width": 3}}),
)
go.Figure(
    [
        go.Scatter(x=rows["hz"], y=np.hypot(rows["real_um_n"], rows["imag_um_n"]), name=name, **style)
        for name, response, style in curves
        for rows in (response.filter(pl.col("axis") == "y"),)
    ],
    layout={
        "title": {"text": "response of the tool tip along y"},
        "xaxis": {"title": {"text": "frequency, Hz"}},
        "yaxis": {"title": {"text": "um per N"}, "type": "log"},
    },
)
