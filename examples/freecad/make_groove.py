"""The groove of examples/programs/groove.ngc as a trajectory of FreeCAD's Robot workbench, exported as KRL.

Runs in FreeCAD, not in counterflex: README.md beside it says how.
"""

import sys

import FreeCAD  # type: ignore[import-not-found]
import KukaExporter  # type: ignore[import-not-found]
import Robot  # type: ignore[import-not-found]

RAPID_MM_S, PLUNGE_MM_S, CUT_MM_S = 250.0, 50.0, 25.0
WAYPOINTS = (  # x, y, z of the tip in the part frame, speed
    (-12.0, 15.0, 60.0, RAPID_MM_S, "above"),
    (-12.0, 15.0, 42.0, RAPID_MM_S, "before"),
    (-12.0, 15.0, 34.0, PLUNGE_MM_S, "down"),
    (72.0, 15.0, 34.0, CUT_MM_S, "groove"),
    (72.0, 15.0, 60.0, RAPID_MM_S, "up"),
)


def main(out: str) -> None:
    """Make the trajectory and export it."""
    document = FreeCAD.newDocument("groove")
    down = FreeCAD.Rotation(180.0, 0.0, 180.0)  # yaw, pitch, roll
    trajectory = Robot.Trajectory()
    for x, y, z, speed, name in WAYPOINTS:
        place = FreeCAD.Placement(FreeCAD.Vector(x, y, z), down)
        point = Robot.Waypoint(place, "LIN", name)
        point.Velocity = speed
        trajectory.insertWaypoints(point)
    path = document.addObject("Robot::TrajectoryObject", "groove")
    path.Trajectory = trajectory
    robot = document.addObject("Robot::RobotObject", "robot")
    KukaExporter.ExportCompactSub(robot, path, out)


main(sys.argv[-1])
