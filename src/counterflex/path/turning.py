"""Sampling of motions that turn the tool: rotary angles go linearly along a motion, as controllers interpolate them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.path.sampling import DWELL_MOTION, RAPID_MOTION, MotionTable, joints_before, sample
from counterflex.path.toolpath import FEED, ToolPath

_TURN_STEP_RAD: Final = np.deg2rad(0.25)
_TRIED: Final = 8  # Chords that the length of a turning motion is measured by
_TURN_LEVER_M: Final = 0.3
"""A change of orientation by 1 rad takes as long as this much path, where no feed says how long it takes."""


@dataclass(frozen=True, eq=False)
class Turning:
    """Turn of the tool along n motions."""

    start_rad: Float  # (n, 3) rotary angles at the start of each motion
    end_rad: Float  # (n, 3) at its end
    feed_rad_s: Float  # (n,) rad/s, of motions that only turn
    # from points (k, 3) m as programmed, angles (k, 3) rad and motions (k,) to tips (k, 3) m and tool axes (k, 3)
    pose: Callable[[Float, Float, Int], tuple[Float, Float]]


@dataclass(frozen=True, eq=False)
class TurnedPath:
    """A sampled path with what the program says at every row."""

    path: ToolPath  # the tool path
    programmed: ToolPath  # the same rows with the points as programmed
    angle_rad: Float  # (rows, 3) rotary angles

    @classmethod
    def sampled(
        cls,
        motions: MotionTable,
        turning: Turning,
        *,
        step_m: float,
        rapid_speed_m_s: float,
        chord_m: float,
        step_s: float = math.inf,
    ) -> TurnedPath:
        """Cut motions that turn the tool into short segments.

        Points as programmed and angles go linearly (an arc along its turn) with the share of the motion; the pose
        follows from both. A motion that turns is divided so that no step turns by more than 0.25 deg or moves the tip
        by more than ``step_m``, rapids too. It lasts as long as its programmed length takes at its feed; one without
        length as long as its angle takes.

        Args:
            turning: How the tool turns along them.
            step_m: Longest step, m, > 0.
            rapid_speed_m_s: Speed assumed for rapids, m/s, > 0.
            chord_m: Allowed chord error of arcs, m, > 0.
            step_s: Longest time of a step, s, > 0.

        Raises:
            InputError: As :func:`~counterflex.path.sampling.sample`.
        """
        n = len(motions)
        swept = np.abs(turning.end_rad - turning.start_rad).max(axis=1, initial=0.0)
        turns = (swept > 0.0) & (motions.kind != DWELL_MOTION)
        length = np.zeros(n)
        if turns.any():
            length[turns] = _tip_length(motions, turning, np.flatnonzero(turns))
        least = np.where(turns, np.ceil(np.maximum(swept / _TURN_STEP_RAD, length / step_m) - 1e-9), 1.0)
        least = np.maximum(least, 1.0).astype(np.int64)
        programmed = sample(
            motions,
            step_m=step_m,
            rapid_speed_m_s=rapid_speed_m_s,
            chord_m=chord_m,
            step_s=step_s,
            least=least,
        )
        if n == 0:
            return cls(programmed, programmed, np.zeros((0, 3)))
        motion = programmed.motion
        share = _shares(motions, motion)[:, None]
        angle = turning.start_rad[motion] + share * (turning.end_rad - turning.start_rad)[motion]
        tip, axis = turning.pose(programmed.p_part_tcp, angle, motion)
        step = np.linalg.norm(np.diff(tip, axis=0, prepend=tip[:1]), axis=1)
        passed_s = np.diff(programmed.time_s, prepend=0.0)
        still = np.linalg.norm(motions.p_end - motions.p_start, axis=1) == 0.0
        rows = np.bincount(motion[share[:, 0] > 0.0], minlength=n)
        alone = turns & still
        own = np.where(turning.feed_rad_s > 0.0, np.linalg.norm(turning.end_rad - turning.start_rad, axis=1), 0.0)
        by_angle = own / np.where(turning.feed_rad_s > 0.0, turning.feed_rad_s, 1.0)
        rapid = turns & (motions.kind == RAPID_MOTION)
        by_tip = np.maximum(length, _TURN_LEVER_M * swept) / rapid_speed_m_s
        whole = np.where(rapid, by_tip, by_angle)
        timed = (alone | rapid)[motion] & (share[:, 0] > 0.0)
        passed_s = np.where(timed, (whole / np.maximum(rows, 1))[motion], passed_s)
        turned_feed = turns[motion] & (programmed.kind == FEED) & (passed_s > 0.0)
        path = replace(
            programmed,
            p_part_tcp=tip,
            axis_part=axis,
            feed_m_s=np.where(turned_feed, step / np.where(passed_s > 0.0, passed_s, 1.0), programmed.feed_m_s),
            time_s=np.cumsum(passed_s),
        )
        return cls(path, replace(programmed, time_s=path.time_s), angle)


def _tip_length(motions: MotionTable, turning: Turning, which: Int) -> Float:
    """Length that the tip covers in the part on some straight motions, (k,) m, by chords."""
    index = np.repeat(which, _TRIED + 1)
    share = np.tile(np.linspace(0.0, 1.0, _TRIED + 1), len(which))[:, None]
    p = motions.p_start[index] + share * (motions.p_end - motions.p_start)[index]
    angle = turning.start_rad[index] + share * (turning.end_rad - turning.start_rad)[index]
    tip = turning.pose(p, angle, index)[0].reshape(len(which), _TRIED + 1, 3)
    out: Float = np.linalg.norm(np.diff(tip, axis=1), axis=2).sum(axis=1)
    return out


def _shares(motions: MotionTable, motion: Int) -> Float:
    """Share of its motion that each row has covered; 0 where a row only leads to the start of its motion."""
    n = len(motions)
    first = np.searchsorted(motion, np.arange(n))
    count = np.bincount(motion, minlength=n)
    lead = np.zeros(n, dtype=np.int64)
    lead[joints_before(motions)] = 1
    lead[0] = 1
    out: Float = (np.arange(len(motion)) - first[motion] + 1 - lead[motion]) / np.maximum(count - lead, 1)[motion]
    return out
