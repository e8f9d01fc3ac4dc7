"""A block with a pocket, its CAM job, and the job through FreeCAD's post-processor ``counterflex``, without a window.

Runs in FreeCAD, not in counterflex: README.md beside it says how. Environment: ``PART_PROGRAM`` the robot program to
write, ``PART_ARGUMENTS`` the arguments of the post-processor.
"""

import importlib
import os
from types import ModuleType

import FreeCAD  # type: ignore[import-not-found]
import Part  # type: ignore[import-not-found]

LENGTH_MM, WIDTH_MM, HEIGHT_MM = 60.0, 60.0, 40.0
POCKET_MM = (15.0, 15.0, 34.0, 45.0, 41.0, 40.0)  # lowest and highest corner


def cam(name: str, before: str) -> ModuleType:
    """Module of the CAM workbench, which FreeCAD 1.0 named anew."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return importlib.import_module(before)


def main(program: str, arguments: str) -> None:
    """Make the part and its job, and hand the job to the post-processor."""
    document = FreeCAD.newDocument("part")
    low, high = FreeCAD.Vector(*POCKET_MM[:3]), FreeCAD.Vector(*POCKET_MM[3:])
    pocket = Part.makeBox(*(high - low), low)
    solid = document.addObject("Part::Feature", "block")
    solid.Shape = Part.makeBox(LENGTH_MM, WIDTH_MM, HEIGHT_MM).cut(pocket)
    document.recompute()
    job = cam("Path.Main.Job", "PathScripts.PathJob").Create("Job", [solid], None)
    for side in ("Xneg", "Xpos", "Yneg", "Ypos", "Zneg", "Zpos"):
        setattr(job.Stock, f"Ext{side}", 0.0)
    tool = job.Tools.Group[0]
    tool.Tool.Diameter = 16.0
    tool.HorizFeed, tool.VertFeed, tool.SpindleSpeed, tool.SpindleDir = "20 mm/s", "5 mm/s", 9000.0, "Forward"
    model = job.Model.Group[0]
    floor = [f"Face{k + 1}" for k, face in enumerate(model.Shape.Faces)
             if abs(face.CenterOfMass.z - low.z) < 1e-6 and face.normalAt(0, 0).z > 0.9]  # fmt: skip
    operation = cam("Path.Op.Pocket", "PathScripts.PathPocketShape").Create("Pocket")
    operation.Base = [(model, floor)]
    document.recompute()
    processor = cam("Path.Post.Processor", "PathScripts.PathPostProcessor").PostProcessor.load("counterflex")
    processor.export([tool, operation], program, arguments)


main(os.environ["PART_PROGRAM"], os.environ["PART_ARGUMENTS"])
