"""Closed-form inverse kinematics of six-axis robots with a spherical wrist: all branches, turns, reach.

The eight branches come from the library py-opw-kinematics (Brandstoetter et al. 2014). Its slots have a fixed order,
``4 wrist + 2 shoulder + elbow``; here they carry names in the sense of a controller's status and turn words:

* shoulder ``front`` / ``back``: the wrist centre lies ahead of or behind axis 1, seen along the arm's own direction;
* elbow ``up`` / ``down``: the elbow lies on the upper or lower side of the line from shoulder to wrist centre while
  the arm reaches outward on its shoulder side (a front arm is ``up`` where theta 3 bends forward);
* wrist ``noflip`` / ``flip``: theta 5 (OPW angle) is positive or negative.
"""

from __future__ import annotations

import functools
import importlib
import importlib.machinery
import importlib.util
import itertools
import math
import sys
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.geometry import rotation
from counterflex.robot.model.description import Opw
from counterflex.robot.model.opw_chain import checked

BRANCHES: Final = tuple(
    f"{'back' if shoulder else 'front'} {'up' if elbow == shoulder else 'down'} {'flip' if wrist else 'noflip'}"
    for wrist, shoulder, elbow in itertools.product((0, 1), (0, 1), (0, 1))
)
"""Names of the eight slots, in the order of :func:`branches`."""

TURN: Final = 2.0 * math.pi
LIMIT_SLACK_RAD: Final = 1e-9
"""Rounding allowed beyond a joint limit."""


@functools.cache
def _solver() -> Any:
    """The library's compiled part alone: its package loads SciPy's rotations, 0.1 s and more of a question."""
    package, name = "py_opw_kinematics", "py_opw_kinematics._internal"
    if name not in sys.modules and (outer := importlib.util.find_spec(package)) is not None:
        spec = importlib.machinery.PathFinder.find_spec(name, outer.submodule_search_locations)
        if spec is not None and spec.loader is not None:
            sys.modules[name] = module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
    return sys.modules.get(name) or importlib.import_module(name)


@functools.lru_cache(maxsize=64)
def _engine(opw: Opw) -> Any:
    """The library's solver on plain arrays, in mm and rad; its public class wraps every pose in a slow object."""
    _library = _solver()
    opw = checked(opw)
    o1, o2, o3, o4, o5, o6 = opw.offsets_rad
    f1, f2, f3, f4, f5, f6 = (sign < 0 for sign in opw.signs)
    model = _library.KinematicModel(
        a1=opw.a1_m / MM,
        a2=opw.a2_m / MM,
        b=opw.b_m / MM,
        c1=opw.c1_m / MM,
        c2=opw.c2_m / MM,
        c3=opw.c3_m / MM,
        c4=opw.c4_m / MM,
        offsets=(o1, o2, o3, o4, o5, o6),
        flip_axes=(f1, f2, f3, f4, f5, f6),
    )
    return _library.Robot(model, False)


def branches(opw: Opw, Ts_base_flange: Float) -> Float:
    """All eight closed-form solutions per flange pose, without regard to joint limits.

    Args:
        opw: Geometry.
        Ts_base_flange: (..., 4, 4) m.

    Returns:
        (..., 8, 6) rad controller angles within one turn; NaN rows where a branch does not exist. Slot k is named
        ``BRANCHES[k]``.

    Raises:
        InputError: The poses have another shape or are not finite.

    Source: Brandstoetter, Angerer, Hofbaur 2014. In a singular wrist (theta 5 = 0) only the sum of axes 4 and 6 is
    determined; theta 4 = 0 is returned there.
    """
    Ts = as_float("T_base_flange", Ts_base_flange)
    if Ts.shape[-2:] != (4, 4):
        raise InputError("T_base_flange has the wrong shape", value=Ts.shape, limit="(..., 4, 4)")
    rows = Ts.reshape(-1, 16).copy()
    rows[:, 3::4][:, :3] /= MM
    q: Float = np.array(_engine(opw).reach(rows)[0], dtype=np.float64)
    flat = Ts.reshape(-1, 4, 4)
    missing = np.isnan(q[..., 0])
    for back in (False, True):
        slots = [k for k in range(8) if BRANCHES[k].startswith("back") == back]
        # The library gives up where the wrist is straight: a missing branch within reach is such a pose.
        suspects = missing[:, slots].any(axis=1)
        for i in np.flatnonzero(suspects):
            if extension(opw, flat[i], back=back) >= 0.0:  # in reach, so the wrist is singular
                q[i, slots] = np.where(missing[i, slots, None], _straight_wrist(opw, flat[i])[slots], q[i, slots])
    return q.reshape(*Ts.shape[:-2], 8, 6)


def _straight_wrist(opw: Opw, T_base_flange: Float) -> Float:
    """(8, 6) solutions of a wrist too straight for the library."""
    # The arm's angles are those of the flange tipped about the wrist centre; the wrist's follow from the axis z of the
    # flange in the forearm, `(cos t4 sin t5, sin t4 sin t5, cos t5)`, with theta 4 = 0 where theta 5 = 0.
    tipped = T_base_flange.copy()
    wrist = T_base_flange[:3, 3] - opw.c4_m * T_base_flange[:3, 2]
    tipped[:3, :3] = T_base_flange[:3, :3] @ rotation.about_x(0.1)
    tipped[:3, 3] = (wrist + opw.c4_m * tipped[:3, 2]) / MM
    q = np.asarray(_engine(opw).reach(tipped.reshape(1, 16))[0], dtype=np.float64)[0]
    signs, offsets = np.array(opw.signs), np.array(opw.offsets_rad)
    theta = signs * q - offsets
    R_arm_flange = (
        np.swapaxes(rotation.about_z(theta[:, 0]) @ rotation.about_y(theta[:, 1] + theta[:, 2]), -1, -2)
        @ (T_base_flange[:3, :3])
    )
    bend = np.hypot(R_arm_flange[:, 0, 2], R_arm_flange[:, 1, 2])
    turn = np.where(bend > 1e-12, np.arctan2(R_arm_flange[:, 1, 2], R_arm_flange[:, 0, 2]), 0.0)
    flip = np.arange(8) >= 4
    theta[:, 3] = np.where(flip & (bend > 1e-12), turn + math.pi, turn)
    theta[:, 4] = np.where(flip, -1.0, 1.0) * np.arctan2(bend, R_arm_flange[:, 2, 2])
    R_wrist_flange = np.swapaxes(rotation.about_z(theta[:, 3]) @ rotation.about_y(theta[:, 4]), -1, -2) @ R_arm_flange
    theta[:, 5] = np.arctan2(R_wrist_flange[:, 1, 0], R_wrist_flange[:, 0, 0])
    out: Float = signs * (theta + offsets)
    return out - TURN * np.round(out / TURN)


def slots_of(opw: Opw, q: Float) -> list[int]:
    """Slots (indices into :data:`BRANCHES`) that rows of controller angles lie in.

    With ``k = hypot(a2, c3)`` and ``psi = atan2(a2, c3)``: elbow by the sign of ``sin(theta3 + psi)``, shoulder by the
    sign of the wrist centre's distance ``a1 + c2 sin(theta2) + k sin(theta2 + theta3 + psi)`` ahead of axis 1, wrist by
    the sign of ``sin(theta5)``.

    Args:
        opw: Geometry.
        q: (n, 6) rad.

    Returns:
        n of 0..7.
    """
    theta = np.array(opw.signs) * as_float("q", q, (None, 6)) - np.array(opw.offsets_rad)
    psi, k = math.atan2(opw.a2_m, opw.c3_m), math.hypot(opw.a2_m, opw.c3_m)
    slots = []
    for second, third, fifth in theta[:, [1, 2, 4]].tolist():
        ahead = opw.a1_m + opw.c2_m * math.sin(second) + k * math.sin(second + third + psi)
        elbow, shoulder, wrist = math.sin(third + psi) < 0.0, ahead < 0.0, math.sin(fifth) < 0.0
        slots.append(4 * int(wrist) + 2 * int(shoulder) + int(elbow))
    return slots


def turns(q: Float, limits_rad: Float) -> Float:
    """All angles equal to ``q`` up to full turns that lie within limits.

    Args:
        q: (6,) rad.
        limits_rad: (6, 2) rad.

    Returns:
        (m, 6) rad, the smallest absolute angles first; m is 0 where an axis has no turn within its limits.
    """
    choices = []
    for angle, (low, high) in zip(q, limits_rad, strict=True):
        first = math.ceil((low - LIMIT_SLACK_RAD - angle) / TURN)
        last = math.floor((high + LIMIT_SLACK_RAD - angle) / TURN)
        choices.append(sorted((angle + k * TURN for k in range(first, last + 1)), key=abs))
    out = sorted(itertools.product(*choices), key=lambda row: sum(abs(a) for a in row))
    return np.array(out, dtype=np.float64).reshape(-1, 6)


def nearest_turn(q: Float, near: Float, limits_rad: Float) -> Float:
    """Each angle of ``q`` moved by full turns to come nearest to ``near``, within limits where a turn is.

    Args:
        q: (6,) rad.
        near: (6,) rad.
        limits_rad: (6, 2) rad.

    Returns:
        (6,) rad; an axis without a turn within its limits keeps the turn nearest to ``near``.
    """
    out = np.empty(6)
    for i in range(6):
        best = q[i] + TURN * np.round((near[i] - q[i]) / TURN)
        low, high = limits_rad[i]
        fits = [best + k * TURN for k in (-1, 0, 1) if low <= best + k * TURN <= high]
        out[i] = min(fits, key=lambda a: abs(a - near[i])) if fits else best
    return out


def extension(opw: Opw, Ts_base_flange: Float, *, back: bool = False) -> Float:
    """Distance of the wrist centre from the border of the arm's reach, positive inside.

    With d the distance of the wrist centre from axis 2 in the arm's plane and ``k = hypot(a2, c3)``:
    ``min(c2 + k - d, d - |c2 - k|)``. Zero is the stretched or folded elbow, negative out of reach.

    ``Ts_base_flange``: (..., 4, 4) m; ``back``: the arm reaches backward over its shoulder.

    Returns:
        (...) m.
    """
    Ts = np.asarray(Ts_base_flange, dtype=np.float64)
    wrist = Ts[..., :3, 3] - opw.c4_m * Ts[..., :3, 2]
    ahead2 = wrist[..., 0] ** 2 + wrist[..., 1] ** 2 - opw.b_m**2
    ahead = np.sqrt(np.maximum(ahead2, 0.0))
    radius = ahead + opw.a1_m if back else ahead - opw.a1_m
    d = np.hypot(radius, wrist[..., 2] - opw.c1_m)
    k = math.hypot(opw.a2_m, opw.c3_m)
    reach = np.minimum(opw.c2_m + k - d, d - abs(opw.c2_m - k))
    out: Float = np.where(ahead2 < 0.0, -(abs(opw.b_m) - np.hypot(wrist[..., 0], wrist[..., 1])), reach)
    return out
