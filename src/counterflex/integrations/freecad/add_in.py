"""FreeCAD's post-processor ``counterflex``: where FreeCAD finds it."""

from typing import Final

from counterflex.app.add_ins import AddIn

ADD_IN: Final = AddIn(
    "FreeCAD 0.20 and later: post-processor of CAM jobs",
    __package__,
    "counterflex_post.py",
    "FreeCAD's macro folder (Macro > Macros > User macros location)",
    "Choose 'counterflex' as processor on the Output page of the job; its arguments are options of 'counterflex"
    " compensate': --cell=CELL.toml --as=krl",
)
