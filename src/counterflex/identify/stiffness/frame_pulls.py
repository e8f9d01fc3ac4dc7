"""Displacements of pulls from what the sensors of a measuring frame show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.identify.data.dataset import Channel, Dataset
from counterflex.identify.data.frame_checks import check_misfit, check_rows
from counterflex.identify.data.measuring_frame import (
    SIX,
    FrameMotion,
    SensorFrame,
    condition,
    meeting_point,
    motion,
    passing,
)
from counterflex.robot.elasticity.chain import ElasticChain, forward

UNLOADED: Final = "s_unloaded"
LOADED: Final = "s_loaded"
MOVED: Final = "d_tcp_base"
ALIGNMENT_RAD: Final = 0.1 * DEG
"""How well the faces stand at right angles to their beams as stated, unless ``sensor_alignment_deg`` says otherwise."""
TURN_PER_M: Final = 1.5
"""Rotation of the tool per displacement, rad/m, counted where the rotation is not found: arms show 0.5 to 1.5."""
_CORRELATED: Final = 0.9
_ROUNDS: Final = 2


def with_displacements(
    chain: ElasticChain, data: Dataset, *, as_stated: bool = False
) -> tuple[Dataset, tuple[str, ...]]:
    """A dataset of pulls with the channel ``d_tcp_base`` found from its measuring frame.

    Standard deviations: of the readings, of faces that do not stand at right angles to their beams (displacement times
    ``sensor_alignment_rad``), of the turn of the tool where it is not found, and, where readings are spare, wider by
    what they disagree.

    Args:
        chain: The cell's: where the tool is in each pose.
        data: Kind ``pulls``; as it is where it has no sensors.
        as_stated: Readings that contradict each other are a remark, not a refusal.

    Raises:
        InputError: The geometry does not show the motion, or the readings contradict each other.
        FileFormatError: A channel is missing, or the displacement is given twice.
    """
    frame = data.sensors
    if frame is None:
        return data, ()
    displacements = [name for name in (MOVED, "d_tracker_target") if data.has(name)]
    if displacements:
        raise FileFormatError(
            "the displacement is given twice, by a measuring frame and as a channel",
            where=data.where,
            value=displacements[0],
            hint="Make two manifests of it, and give both",
        )
    before, after = data.channel(UNLOADED), data.channel(LOADED)
    noise = np.hypot(_sigma(before), after.need_sigma())
    if not np.all(noise > 0.0):
        raise FileFormatError(
            "the change of a reading has no standard deviation",
            where=data.where,
            value=f"0 for sensor '{frame.names[int(np.argmin(noise.min(axis=0)))]}'",
            limit="> 0",
        )
    R, reference = places(chain, data, frame)
    check_rows(data, frame, before.values, after.values, reference)
    settled = _settled(data, frame, before.values, after.values, noise, reference)
    remarks: tuple[str, ...] = ()
    wrong = check_misfit(frame, before.values, after.values, settled, reference)
    if wrong:
        if not as_stated:
            raise InputError(wrong[0], where=data.where, hint=f"{wrong[1]}. If all is right, add --set as_stated=true")
        remarks = (*remarks, f"{data.name}: {wrong[0]}; used as stated, as requested")
    wider = float(np.median(settled.misfit())) if settled.spare else 1.0
    count = settled.d.shape[1] // 3
    turn = np.zeros((len(data), 3 * count, 3 * count))
    for i in range(0, 3 * count, 3):
        turn[:, i : i + 3, i : i + 3] = R
    covariance = turn @ settled.covariance @ np.swapaxes(turn, 1, 2) * max(1.0, wider) ** 2
    sigma = np.sqrt(np.einsum("nii->ni", covariance))
    channel = Channel(
        MOVED,
        (turn @ settled.d[:, :, None])[..., 0],
        sigma,
        "m rad" if count == 2 else "m",
        f"{after.source}, by {len(frame)} sensors",
        (*before.columns, *after.columns),
    )
    return replace(data, channels={**data.channels, MOVED: channel}), (*remarks, *_remarks(data, frame, settled))


def summary(data: Dataset) -> dict[str, Any] | None:
    """Summary of the sensors of a dataset, without a cell; None where it has none.

    Returns:
        ``sensors``, ``spare``, ``condition``, ``least_mm``, ``mean_mm``, ``largest_mm`` of the displacement of the
        point that their normals meet in, ``left_um`` and ``misfit`` where readings are spare, and ``lines`` in words.

    Raises:
        InputError: As :func:`with_displacements`.
        FileFormatError: A standard deviation is missing.
    """
    frame = data.sensors
    if frame is None:
        return None
    before, after = data.channel(UNLOADED), data.channel(LOADED)
    reference = meeting_point(frame, before.values)
    check_rows(data, frame, before.values, after.values, reference)
    noise = np.hypot(_sigma(before), after.need_sigma())
    settled = _settled(data, frame, before.values, after.values, noise, reference)
    wrong = check_misfit(frame, before.values, after.values, settled, reference)
    if wrong:
        raise InputError(wrong[0], where=data.where, hint=wrong[1])
    size = np.linalg.norm(settled.d[:, :3], axis=1) / MM
    worst = max(condition(frame, s, r)[0] for s, r in zip(before.values, reference, strict=True))
    return {
        "sensors": len(frame),
        "spare": settled.spare,
        "condition": worst,
        "least_mm": float(np.min(size)),
        "mean_mm": float(np.mean(size)),
        "largest_mm": float(np.max(size)),
        "left_um": float(np.sqrt(np.mean(settled.residual**2))) / UM if settled.spare else None,
        "misfit": float(np.median(settled.misfit())) if settled.spare else None,
        "lines": [
            f"displacement of the point that the sensors look at: {np.min(size):.3g} to {np.max(size):.3g} mm, "
            f"condition {worst:.3g}",
            *(text.removeprefix(f"{data.name}: ") for text in _remarks(data, frame, settled)),
        ],
    }


def places(chain: ElasticChain, data: Dataset, frame: SensorFrame) -> tuple[Float, Float]:
    """Axes of the sensors in the base (n, 3, 3), and the measured point in them (n, 3) m, of each row.

    ``data``: With ``q``; with ``R_base_frame`` (and ``p_base_frame``) where the axes are those of the frame. Raises
    FileFormatError: the place of the frame is missing.
    """
    n = len(data)
    p_tcp = np.asarray(data.settings.get("p_tcp_measured_m", np.zeros(3)), dtype=np.float64)
    if p_tcp.shape != (3,):
        raise FileFormatError("setting p_tcp_measured_m is no point near the tool", where=data.where)
    if frame.axes == "tcp":
        return forward(chain, data.values("q"))[:, :3, :3], np.broadcast_to(p_tcp, (n, 3))
    T = forward(chain, data.values("q"))
    p_base = T[:, :3, 3] + (T[:, :3, :3] @ p_tcp[:, None])[..., 0]
    if frame.axes == "base":
        return np.broadcast_to(np.eye(3), (n, 3, 3)), p_base
    if not data.has("R_base_frame"):
        raise FileFormatError(
            "sensors in axes of the measuring frame need its orientation in each row",
            where=data.where,
            limit="channel R_base_frame, and p_base_frame unless its origin is the measured point",
        )
    R = data.values("R_base_frame")
    if not data.has("p_base_frame"):
        return R, np.zeros((n, 3))
    offset = p_base - data.values("p_base_frame")
    return R, (np.swapaxes(R, 1, 2) @ offset[:, :, None])[..., 0]


def _sigma(channel: Channel) -> Float:
    """Of the unloaded readings: none is needed where they are constants, as of gauges that were set to zero."""
    if channel.sigma is None and not channel.columns:
        return np.zeros_like(channel.values)
    return channel.need_sigma()


def _settled(
    data: Dataset, frame: SensorFrame, before: Float, after: Float, noise: Float, reference: Float
) -> FrameMotion:
    """The motion, with the standard deviations that grow with it."""
    alignment = float(data.settings.get("sensor_alignment_rad", ALIGNMENT_RAD))
    # With six sensors the turn is found; with fewer it is left out, and what it would have shown is doubt.
    by = passing(frame, before, reference) if len(frame) < SIX else np.zeros_like(before)
    estimate = motion(frame, before, after, noise, reference)
    for _ in range(_ROUNDS):
        size = np.linalg.norm(estimate.d[:, :3], axis=1)[:, None]
        sigma = np.sqrt(noise**2 + (alignment * size) ** 2 + (TURN_PER_M * size * by) ** 2)
        estimate = motion(frame, before, after, sigma, reference)
    return estimate


def _remarks(data: Dataset, frame: SensorFrame, motion: FrameMotion) -> tuple[str, ...]:
    out = []
    if motion.d.shape[1] == 3:
        out.append(
            f"{data.name}: {len(frame)} sensors are fewer than six, so only the displacement is found and the turn of "
            "the tool is not"
        )
    if motion.spare:
        residual_m = float(np.sqrt(np.mean(motion.residual**2)))
        out.append(
            f"{data.name}: {len(frame)} sensors, {motion.spare} more than are needed; they agree within "
            f"{residual_m / UM:.2g} um, {float(np.median(motion.misfit())):.2g} times what their "
            "standard deviations give"
        )
    else:
        out.append(f"{data.name}: {len(frame)} sensors, none spare: a wrong one is not noticed among them")
    size = np.sqrt(np.einsum("nii->ni", motion.covariance))
    correlation = motion.covariance / (size[:, :, None] * size[:, None, :]) - np.eye(size.shape[1])
    worst = float(np.max(np.abs(np.median(correlation, axis=0))))
    if worst > _CORRELATED:
        far = float(np.median(np.linalg.norm(size[:, :3], axis=1))) / UM
        out.append(
            f"{data.name}: displacement (to {far:.2g} um) and turn by the frame are correlated ({worst:.2f}): the "
            "measured point lies far from where the sensors look; state one near there as p_tcp_measured_mm"
        )
    return tuple(out)
