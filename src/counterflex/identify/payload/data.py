"""From datasets to a flange sensor's readings: orientation of the sensor, motion, clock and temperature of each row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.payload.groups import orientations
from counterflex.identify.payload.residuals import SensorReadings
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.sensing.carrier import carrier_pose, hose_rotation, mass_behind, segment_index
from counterflex.sensing.flange_sensor import FlangeSensor

KINDS = ("sensor_poses", "sensor_motion")
CHANNEL = "w_sensor"
_ORDER = 3
_WINDOWS: Final = 8
"""Windows after which another group of rows begins."""


def with_added_mass(chain: ElasticChain, segment: str, mass_kg: float, p_seg_com: Float) -> ElasticChain:
    """The chain with another sum of masses behind a body, the difference booked on the heaviest body there.

    ``p_seg_com``: (3,) m, centre of gravity in the body's frame.
    """
    split = shared_mass(chain, segment, mass_kg, p_seg_com)
    mass, com = chain.mass.copy(), chain.com.copy()
    for i, (kg, p) in split.items():
        mass[i], com[i] = kg, p
    return replace(chain, mass=mass, com=com)


def shared_mass(chain: ElasticChain, segment: str, mass_kg: float, p_seg_com: Float) -> dict[int, tuple[float, Float]]:
    """Masses and centres of gravity of single bodies that add up to what was found.

    The heaviest body behind the sensor takes the difference. Where that left it without mass, all bodies are scaled.

    ``p_seg_com``: (3,) m, its centre of gravity in the body's frame.

    Returns:
        By index of the segment: kg, and (3,) m in its own frame; empty where nothing is behind the sensor.
    """
    first = segment_index(chain, segment)
    bodies = range(first + 1, chain.n)
    if not bodies or mass_kg <= 0.0:
        return {}
    Ts = {}
    T = np.eye(4)
    for i in bodies:
        T = T @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
        Ts[i] = T
    total, com = mass_behind(chain, segment)
    heavy = first + 1 + int(np.argmax(chain.mass[first + 1 :]))
    rest = mass_kg - (total - float(chain.mass[heavy]))
    if rest > 0.05 * mass_kg:
        others = total * com - chain.mass[heavy] * pose.transform(Ts[heavy], chain.com[heavy])
        moved = pose.transform(pose.inverse(Ts[heavy]), (mass_kg * p_seg_com - others) / rest)
        return {heavy: (rest, moved)}
    scale = mass_kg / total
    out = {}
    for i in bodies:
        if chain.mass[i] > 0.0:
            place = pose.transform(Ts[i], chain.com[i]) + p_seg_com - com
            out[i] = (scale * float(chain.mass[i]), pose.transform(pose.inverse(Ts[i]), place))
    return out


def readings(
    data: Dataset, chain: ElasticChain, sensor: FlangeSensor, *, reference_c: float, start_s: float, window_s: float
) -> SensorReadings:
    """Readings of one dataset, as residuals.

    Args:
        data: Of a kind in :data:`KINDS`; ``q`` or the rotation of the flange or tool, ``w_sensor``; where present
            ``temperature_c``, ``time_s``, and for motions ``accelerometer_sensor`` in place of the acceleration
            computed from ``q``.
        chain: The cell with its masses: the bent arm gives the sensor's orientation.
        sensor: Of the cell before; where it names the body that the hose pack comes from, the data need ``q``.
        reference_c: Temperature that the bias belongs to.
        start_s: Time that the bias belongs to.
        window_s: Motions: length of the local cubic (Savitzky-Golay) that smooths readings and differentiates ``q``.

    Raises:
        FileFormatError: A channel is missing or holds values that are not numbers.
    """
    w = _finite(data, CHANNEL)
    sigma = data.channel(CHANNEL).need_sigma()
    zero = np.zeros((len(data), 3))
    time_s = _finite(data, "time_s")[:, 0] if data.has("time_s") else np.full(len(data), start_s)
    warmer = _finite(data, "temperature_c")[:, 0] - reference_c if data.has("temperature_c") else zero[:, 0]
    T_base_sensor = _pose(data, chain, sensor) @ sensor.T_seg_sensor
    R = T_base_sensor[:, :3, :3]
    R_t = np.swapaxes(R, -1, -2)
    if axes_of(data) == "base":
        w = (R_t[:, None] @ w.reshape(-1, 2, 3, 1)).reshape(-1, 6)
        sigma = np.sqrt((R_t[:, None] ** 2 @ sigma.reshape(-1, 2, 3, 1) ** 2).reshape(-1, 6))
    gamma = R_t @ chain.gravity
    R_rest = R
    if sensor.hose_from:
        q = _finite(data, "q")
        R_rest = hose_rotation(chain, sensor.hose_from, sensor.segment, q) @ sensor.T_seg_sensor[:3, :3]
    block = SensorReadings(
        data.name,
        data.group,
        sigma,
        w,
        R,
        R_rest,
        gamma,
        zero,
        zero,
        time_s - start_s,
        np.asarray(warmer, dtype=np.float64),
    )
    if data.kind != "sensor_motion":
        return block
    _in_time(data, time_s)
    step_s = float(np.median(np.diff(time_s)))
    width = max(2 * round(0.5 * window_s / step_s) + 1, _ORDER + 2)
    if width > len(data):
        raise FileFormatError(
            "the recorded motion is shorter than the window that smooths it",
            where=data.where or data.name,
            value=f"{len(data)} samples",
            limit=f">= {width}",
        )

    def smooth(values: Float, derivative: int) -> Float:
        out: Float = scipy.signal.savgol_filter(values, width, _ORDER, deriv=derivative, delta=step_s, axis=0)
        return out

    rate = smooth(R.reshape(-1, 9), 1).reshape(R.shape)
    spin = 0.5 * (R_t @ rate - np.swapaxes(R_t @ rate, -1, -2))
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    if data.has("accelerometer_sensor"):
        gamma = -smooth(_finite(data, "accelerometer_sensor"), 0)
    else:
        gamma = gamma - (R_t @ smooth(T_base_sensor[:, :3, 3], 2)[:, :, None])[:, :, 0]
    block = replace(
        block,
        w_sensor=smooth(w, 0),
        sigma=sigma / np.sqrt(width / 3.0),
        gamma=gamma,
        omega=omega,
        alpha=smooth(omega, 1),
        group=np.arange(len(data), dtype=np.int64) // (_WINDOWS * width),
    )
    keep = np.zeros(len(data), dtype=np.bool_)
    keep[width : len(data) - width : max(1, width // 2)] = True
    # A window that reaches into the next group holds readings of both: it would be predicted from itself.
    row, half = np.arange(len(data), dtype=np.int64), width // 2
    keep &= (row - half) // (_WINDOWS * width) == (row + half) // (_WINDOWS * width)
    return block.subset(keep)


def axes_of(data: Dataset) -> str:
    """Axes that ``w_sensor`` is given in: ``sensor``, or ``base`` (moments about the sensor's origin all the same)."""
    return str(data.settings.get(f"{CHANNEL}_axes", "sensor"))


def clock(datasets: Sequence[Dataset], fallback_c: float) -> tuple[float, float]:
    """Beginning of all data (s), and their mean temperature (deg C, to one tenth), where the bias is best known."""
    starts = [float(np.min(d.values("time_s"))) for d in datasets if d.has("time_s") and len(d)]
    warm = [d.values("temperature_c")[:, 0] for d in datasets if d.has("temperature_c")]
    return min(starts, default=0.0), (round(float(np.mean(np.concatenate(warm))), 1) if warm else fallback_c)


def distinct(block: SensorReadings) -> int:
    """Number of orientations that differ by more than 2 deg in the direction of gravity."""
    return int(orientations(block.R_base_sensor).max(initial=-1)) + 1


def check_orientations(blocks: Sequence[SensorReadings], where: str) -> tuple[str, ...]:
    """Refuse what cannot give weight and bias; say what a poor set cannot see.

    Raises:
        InputError: Fewer than three directions of gravity.
    """
    together = np.concatenate([b.R_base_sensor for b in blocks])
    count = distinct(replace(blocks[0], R_base_sensor=together))
    rows = len(together)
    if count < 3:
        raise InputError(
            "too few different orientations for weight and bias of the sensor",
            where=where,
            value=f"{count} in {rows} rows",
            limit="3 or more that differ by over 2 deg in the direction of gravity, 8 or more better",
            hint="Turn axes 4 to 6 between the readings; repeats of one orientation do not count",
        )
    down = together[:, 2, :]
    spread = np.linalg.svd(down - down.mean(axis=0), compute_uv=False) / np.sqrt(rows)
    out = []
    if spread[2] < 0.1:
        out.append(
            "All directions of gravity lie near one plane in sensor axes: mass, bias and mounting across that plane "
            "depend on the priors. Add orientations that turn the tool out of it"
        )
    if count < 8:
        out.append(f"Only {count} different orientations: no redundancy for the hose pack and little for outliers")
    return tuple(out)


def _pose(data: Dataset, chain: ElasticChain, sensor: FlangeSensor) -> Float:
    if data.has("q"):
        return carrier_pose(chain, sensor.segment, _finite(data, "q"))
    index = segment_index(chain, sensor.segment)
    for name, T_seg_known in (("R_base_flange", None), ("R_base_tcp", chain.T_last_tcp)):
        if data.has(name):
            R = data.values(name)
            if not np.all(np.isfinite(R)):
                raise _bad(data, name, int(np.argwhere(~np.isfinite(R))[0, 0]))
            if T_seg_known is None:
                step = pose.inverse(chain.T_segment_flange)
                for i in range(chain.flange_segment + 1, index + 1):
                    step = step @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
                R_known_seg = step[:3, :3]
            else:
                step = np.eye(4)
                for i in range(index + 1, chain.n):
                    step = step @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
                R_known_seg = (step @ T_seg_known)[:3, :3].T
            return pose.make(R @ R_known_seg, np.zeros(3))
    raise FileFormatError(
        "the orientation of the sensor is not in the data",
        where=data.where or data.name,
        limit="channel q, R_base_flange or R_base_tcp",
        hint="Map one of them in the manifest: [channels.q] columns = [...]",
    )


def _finite(data: Dataset, name: str) -> Float:
    values = data.values(name)
    bad = ~np.all(np.isfinite(values), axis=1)
    if np.any(bad):
        raise _bad(data, name, int(np.flatnonzero(bad)[0]))
    return values


def _bad(data: Dataset, name: str, row: int) -> FileFormatError:
    return FileFormatError(
        f"channel '{name}' holds a value that is not a number",
        where=data.place(row),
        hint="Remove the row, or the cause: an empty cell of the table is read as not a number",
    )


def _in_time(data: Dataset, time_s: Float) -> None:
    if not data.has("time_s") or np.any(np.diff(time_s) <= 0.0):
        raise FileFormatError(
            "a recorded motion needs rising times",
            where=data.where or data.name,
            hint="Map [channels.time_s]; for single orientations use the kind sensor_poses",
        )
