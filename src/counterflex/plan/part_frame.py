"""What is left of own-weight sag once the part frame has been measured.

A part frame measured with the robot itself (touching datum points) already contains the sag and the geometric error
that the robot has at those points: there they cancel. What remains is how sag varies across the part. A frame measured
with an external instrument contains nothing, and the whole sag remains.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose, registration

_ROUNDING_M = 1e-12
"""Deviations below this are what the transforms round: a robot without sag deviates by exactly nothing."""


def true_part_frame(T_base_part: Float, datum_points_part: Float, sag_base_datum: Float) -> Float:
    """Where the part is when its frame was measured by touching points with a sagging robot.

    The controller saw ``T_base_part p`` at each datum point p; the tool was truly at that position plus the sag.

    Args:
        T_base_part: (4, 4) the frame the controller got.
        datum_points_part: (k, 3) m, k >= 3.
        sag_base_datum: (k, 3) m, sag of the tool tip at those points, base axes.

    Returns:
        (4, 4) the pose of the part that best explains what was touched.
    """
    seen = pose.transform(T_base_part, datum_points_part)
    T_base_true, _ = registration.register(seen + sag_base_datum, datum_points_part)
    return T_base_true


def sag_deviation(T_base_part: Float, T_base_true: Float, p_part: Float, sag_base: Float) -> Float:
    """Deviation of the unloaded tool tip from the programmed point, in the frame of the part as it truly lies.

    Args:
        T_base_part: (4, 4) the frame the controller uses.
        T_base_true: (4, 4) from :func:`true_part_frame`, or ``T_base_part`` for an externally measured frame.
        p_part: (n, 3) m programmed points.
        sag_base: (n, 3) m sag of the tool tip there, base axes.

    Returns:
        (n, 3) m, actual - nominal.
    """
    p_base = pose.transform(T_base_part, p_part) + sag_base
    out: Float = pose.transform(pose.inverse(T_base_true), p_base) - np.asarray(p_part, dtype=np.float64)
    out[np.abs(out) < _ROUNDING_M] = 0.0
    return out
