"""
Which posture bends least?
==========================

Milling leaves two things free: the configuration of the arm and the rotation of the spindle about the tool axis. Both
change how soft the arm is across the path. This page tries all of them for a groove and shows what the choice is
worth, before anything is compensated.
"""

# sphinx_gallery_thumbnail_path = "_static/gallery/posture.png"
from __future__ import annotations

import tempfile
from pathlib import Path

import polars as pl

import counterflex as cf

scratch = tempfile.TemporaryDirectory()
folder = cf.examples(Path(scratch.name))
chosen = cf.choose_posture(folder / "groove.ngc", folder / "cell-small.toml", rotations=36)

# %%
# The present posture and the chosen one
# --------------------------------------
#
# ``deflection_um`` is what 99.7 % of the path in the cut stay below, counted square to the walls and the floor that
# the tool makes: the part of the bending that shows on the workpiece.

keys = ("branch", "rotation_about_tool_deg", "deflection_um", "largest_um", "reversals", "limit_margin_deg")
table = pl.DataFrame(
    [{"posture": name} | {key: chosen.summary[name][key] for key in keys} for name in ("present", "chosen")]
)
print(f"{chosen.summary['reduction_percent']:.0f} % less; {chosen.summary['poses']} postures tried")
table

# %%
# All postures
# ------------
#
# A curve for each configuration of the arm. Gaps are rotations in which a joint, a cable or the wrist singularity
# forbids the program, or the spindle would touch something.

chosen.plot("rotations")

# %%
# Flipping the wrist leaves the arm where it is, so that the two curves of a shoulder lie on one another; what tells
# them apart are joint limits and cables.
#
# What is left after the choice is compensated: a small deflection leaves a small error of its prediction.
