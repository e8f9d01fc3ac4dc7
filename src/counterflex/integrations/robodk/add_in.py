"""RoboDK's script ``counterflex_compensate``: where RoboDK finds it."""

from typing import Final

from counterflex.app.add_ins import AddIn

ADD_IN: Final = AddIn(
    "RoboDK 5 and later: script that compensates a program of the station (not tried with RoboDK itself)",
    __package__,
    "counterflex_compensate.py",
    "RoboDK's folder Scripts, or Apps/counterflex",
    "Run it in RoboDK (Tools > Run Script); station parameters COUNTERFLEX_CELL and COUNTERFLEX_ARGUMENTS hold the cell"
    " file and options of 'counterflex compensate'",
)
