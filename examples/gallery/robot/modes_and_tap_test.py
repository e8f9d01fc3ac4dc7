"""
How does the arm swing? Modes and a tap test
============================================

An arm with a spindle swings at some 10 Hz. That limits how fast a feed may change, and it is where low-frequency
chatter comes from. This page computes the modes of a cell, says how well they are known, and corrects the masses of
the model by a tap test: hit the tip of the tool with an instrumented hammer and measure how it moves.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/modes_and_tap_test.png"
from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import polars as pl

import counterflex as cf
from counterflex.app import examples
from counterflex.app.cell_modes import modes_in
from counterflex.app.lowest_mode import STATED
from counterflex.core.units import DEG, UM
from counterflex.files.tap_test import read_tap_test
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import frequency_response
from counterflex.plan.tap_fit import fit_masses, frac

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
examples.write_all(folder / "cell.toml")
cell = cf.read_cell(folder / "cell-small.toml")
joints_deg = [0.0, -90.0, 110.0, 0.0, 40.0, 0.0]

# %%
# Modes from the cell file
# ------------------------
#
# Each row is a natural frequency with the interval that nine of ten robots with these data lie in: masses come from
# the catalogue and are assumed to some 15 %, compliances to 35 %. The last column names the springs that bend most.

found = modes_in(cell, np.array(joints_deg) * DEG)
rows = [
    {
        "mode": k + 1,
        "hz": mode["hz"],
        "from_hz": mode["of_90_percent_hz"][0],
        "to_hz": mode["of_90_percent_hz"][1],
        "springs": ", ".join(f"{spring['name']} {100.0 * spring['share']:.0f} %" for spring in mode["springs"][:2]),
    }
    for k, mode in enumerate(found.summary["modes"])
]
pl.DataFrame(rows)

# %%
# A tap test
# ----------
#
# Your file comes here: columns ``frequency_hz,force,motion,real_um_n,imag_um_n`` in base axes. To have one, we tap a
# robot that differs from the cell file as real ones do: a spindle 20 % heavier, an arm 25 % heavier, compliances 10 %
# larger, and 3 % of noise in the response.

heavier = {"spindle": 1.2, "axis3": 1.15, "link_arm": 1.25}
factor = np.array([heavier.get(name, 1.0) for name in found.chain.names])
true_chain = replace(found.chain, mass=found.chain.mass * factor, compliance=1.1 * found.chain.compliance)
M, stiffness, J, _ = matrices(true_chain, found.q)
hz = np.arange(3.0, 40.5, 0.5)
true_response = frequency_response(M, stiffness, J, 2e-3, (None,) * 6, 2.0 * math.pi * hz)
noise = np.random.default_rng(1)
lines = ["frequency_hz,force,motion,real_um_n,imag_um_n"]
for axis, name in enumerate("xyz"):
    measured = true_response[:, axis, axis] / UM
    measured = measured + 0.03 * np.abs(measured) * (noise.normal(size=len(hz)) + 1j * noise.normal(size=len(hz)))
    lines += [f"{f:g},{name},{name},{value.real:.5f},{value.imag:.5f}" for f, value in zip(hz, measured, strict=True)]
(folder / "tap_test.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
print("\n".join(lines[:4]))

# %%
# What the test says of the masses
# --------------------------------
#
# The fit starts from the cell file with what is known of each value, and moves what the data see. A mass that the
# test does not see keeps its value and says so.

tap = read_tap_test(folder / "tap_test.csv")
fit = fit_masses(found.chain, found.q, tap, found.damping_s, found.spread.mass, STATED)
masses = pl.DataFrame(
    [
        {
            "body": found.chain.names[body],
            "stated_kg": float(found.chain.mass[body]),
            "fitted_kg": float(found.chain.mass[body] * fit.factor[k]),
            "sigma_kg": float(found.chain.mass[body] * fit.factor[k] * fit.sigma[k]),
            "true_kg": float(true_chain.mass[body]),
            "seen": bool(fit.seen[k]),
        }
        for k, body in enumerate(fit.bodies.tolist())
    ]
)
print(masses)
print(f"all stiffnesses x {fit.stiffness_factor:.3f} (true: {1.0 / 1.1:.3f})")
print(f"agreement (FRAC) {frac(tap.receptance, fit.before):.3f} before, {frac(tap.receptance, fit.after):.3f} after")

# %%
# The response along y of the base, measured and computed. A peak that stands at the wrong frequency is a mass or a
# stiffness; one of the wrong height is damping.

y_axis = np.flatnonzero(tap.force_base[:, 1] > 0.5)
frequency = tap.omega_rad_s[y_axis] / (2.0 * math.pi)
go.Figure(
    [
        go.Scatter(
            x=frequency, y=np.abs(tap.receptance[y_axis]) / UM, name="tap test", mode="markers",
            marker={"color": "#111827", "size": 6},
        ),
        go.Scatter(
            x=frequency, y=np.abs(fit.before[y_axis]) / UM, name="cell file", line={"color": "#c2410c", "dash": "dash"}
        ),
        go.Scatter(x=frequency, y=np.abs(fit.after[y_axis]) / UM, name="fitted", line={"color": "#0369a1", "width": 3}),
    ],
    layout={
        "title": {"text": "response of the tool tip along y"},
        "xaxis": {"title": {"text": "frequency, Hz"}},
        "yaxis": {"title": {"text": "um per N"}, "type": "log"},
    },
)  # fmt: skip
