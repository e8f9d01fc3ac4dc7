"""Work of the parts of planning, so that progress moves by what is done and the time left can be told."""

from __future__ import annotations

from typing import Final

JOINTS: Final = "joint angles"
UNDISTURBED: Final = "undisturbed cut"
CORRECTION: Final = "correction"
TRIAL: Final = "compensated program"
MENDED: Final = "compensated program, mended"
UNCOMPENSATED: Final = "uncompensated program"
"""Parts of the work, as the progress names them."""


def work_of(points: int, duration_s: float, *, moves: bool, mends: bool, predicts: bool) -> dict[str, float]:
    """Work of each part: what it costs to load, and then by points and by seconds of the program.

    A trial with the robot in motion steps through time, whatever the number of points; everything else goes by
    points. The units are processor seconds of programs of 374 to 30 000 points and of 4 to 450 s, at loads of 4 to 8.

    Args:
        points: Of the path.
        duration_s: Of the path, s.
        moves: Trials have the robot in motion.
        mends: The correction is tried and mended, see :func:`counterflex.plan.compensate.plan`.
        predicts: The uncompensated program is predicted, too.

    Returns:
        By name, in the order in which the parts are done.
    """
    trial = 0.05 + 3e-5 * points + (0.024 * duration_s if moves else 0.0)
    work = {JOINTS: 0.01 + 1e-5 * points, UNDISTURBED: 0.05 + 4e-5 * points, CORRECTION: 0.25 + 7e-5 * points}
    work |= {TRIAL: trial} if predicts or mends else {}
    work |= {MENDED: trial} if mends else {}
    return work | ({UNCOMPENSATED: trial} if predicts else {})
