"""
Cutting constants from slots
============================

The force of a plan is as good as its constants, and a table knows neither the tool nor the batch of material. Some
slots and side cuts with a force sensor tell the constants of *this* tool in *this* material. This page proposes the
cuts, measures them on a simulated cell, fits five forms of the force law and takes the simplest one that predicts
cuts it has not seen.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/cutting_constants.png"
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
robot = cf.SimulatedCell(cell, seed=7, family="wide")

# %%
# Propose the cuts
# ----------------
#
# The proposal places slots and side cuts in the blank, over a wide range of feeds, within the force that the sensor
# allows, and writes the program that makes them. Feeds that differ by a factor of four or more tell exponent and edge
# force apart.

proposed = cf.propose("cutting", 8, cell_file, folder / "fit", seed=1)
print(pl.DataFrame(proposed["expected"]))
program = (folder / "fit" / "test_cuts.ngc").read_text(encoding="utf-8")
print("\n".join(program.splitlines()[:14]))

# %%
# Measure
# -------
#
# Force over time, with air before and behind every cut: the zero of the sensor is taken from there.

measured = robot.measure(folder / "fit", folder / "data")
record = pl.read_csv(folder / "data" / "cutting.csv", infer_schema_length=None)
print(f"{measured['rows']} samples: {', '.join(record.columns)}")

# %%
# Identify
# --------
#
# Each cut is predicted by the constants of the others: an error on data that were not used, before and after.

result = cf.identify("cutting", [folder / "data" / "cutting.toml"], cell_file, folder / "found")
for figure in result.summary["headline"]:
    print(f"{figure['text']}: {figure['value']:.3g} %, with the constants of the cell file {figure['nominal']:.3g} %")
figures = result.figures
forms = {name[8:-8]: value for name, value in figures.items() if name.startswith("holdout_")}
for name, value in forms.items():
    print(f"error of the form on cuts not used: {value:5.2f} %  {name}")

# %%
# The constants refer to the chip thickness that the cuts had, not to 1 mm as in tables: that is far outside of the
# cuts, and less certain.

table = pl.DataFrame(
    [
        {
            "constant": f"k{i} at {figures['h_ref_um']:.0f} um",
            "n_mm2": figures[f"k{i}_ref_n_mm2"],
            "sigma_n_mm2": figures[f"k{i}_ref_sigma_n_mm2"],
        }
        for i in "cra"
    ]
)
print(table)
at_h_ref = figures["kc_ref_sigma_n_mm2"] / figures["kc_ref_n_mm2"]
at_1_mm = figures["kc11_sigma_n_mm2"] / figures["kc11_n_mm2"]
print(f"standard deviation of kc: {at_h_ref:.1%} there, {at_1_mm:.1%} at 1 mm")

# %%
# Against the truth
# -----------------
#
# Force per millimetre of edge over the thickness of the chip: the law of the cell file, the identified one, and the
# true one of the simulated cell, which has a ploughing force that no form of the law has. The grey band is the range
# of the cuts.

chip_um = np.linspace(2.0, 80.0, 79)
curves = {
    "cell file": (cell.edge_force(chip_um), "#c2410c", "dash"),
    "identified": (result.cell.edge_force(chip_um), "#0369a1", "solid"),
    "true": (robot.edge_force(chip_um), "#111827", "dot"),
}
picture = go.Figure(
    [
        go.Scatter(
            x=chip_um, y=force[:, k], name=f"{name}, {direction}", legendgroup=name,
            line={"color": colour, "dash": dash, "width": 3 - k},
        )
        for name, (force, colour, dash) in curves.items()
        for k, direction in enumerate(("cutting", "radial"))
    ],
    layout={
        "title": {"text": "force on a millimetre of edge"},
        "xaxis": {"title": {"text": "chip thickness, um"}},
        "yaxis": {"title": {"text": "N/mm"}, "rangemode": "tozero"},
    },
)  # fmt: skip
picture.add_vrect(x0=figures["h_least_um"], x1=figures["h_largest_um"], fillcolor="#6b7280", opacity=0.12, line_width=0)

# %%
# ``found/cell.toml`` has the new law in its table ``[material]``, with the range of chips that it holds for; a plan
# outside of it warns. The procedure is described in :doc:`/identify/cutting`.
