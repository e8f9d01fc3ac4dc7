"""From datasets to a flange sensor's readings: orientation of the sensor, motion, clock and temperature of each row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.units import DEG
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.payload.residuals import SensorReadings
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.sensing.carrier import carrier_pose, hose_rotation, mass_behind, segment_index
from counterflex.sensing.flange_sensor import FlangeSensor


def sensor_before(cell: CellModel) -> FlangeSensor:
    """The sensor before identification: of the cell, or in the body named ``sensor`` with its axes.

    Raises InputError: the cell names no sensor and no body of its end effector is called so. Raises ModelError: what
    the cell holds as its sensor is none.
    """
    table = cell.tables.get("sensor")
    if isinstance(table, FlangeSensor):
        return table
    if table is not None:
        raise ModelError("the sensor of the cell is not a sensor", value=type(table).__name__)
    chain = cell.chain
    name = next((s.name for s in cell.end_effector.segments if "sensor" in s.name), None)
    if name is None:
        raise InputError(
            "the cell has no force sensor",
            where=cell.name,
            limit=", ".join(s.name for s in cell.end_effector.segments) or "no body in the end effector",
            hint='Add a table [sensor] with segment = "NAME OF THE BODY THAT CARRIES IT" to the cell file',
        )
    mass_kg, p_seg_com = mass_behind(chain, name)
    return FlangeSensor(name, np.eye(4), mass_kg, p_seg_com)


# Which readings of a flange sensor are one measurement: those in the same orientation. What the model of the sensor
# lacks (hose pack, cross-talk, the bent arm) is the same in every reading of one orientation, however often it is read
# or copied. Weight, zero and centre of gravity show by the direction of gravity in sensor axes alone, so readings whose
# directions of gravity are within :data:`ALIKE_RAD` of one that stands for them are one group.

ALIKE_RAD: Final = 2.0 * DEG
"""Angle between directions of gravity in sensor axes up to which two readings are one orientation."""


def orientations(R_base_sensor: Float) -> Int:
    """Number of the orientation that each reading is one of, in the order in which they first come.

    ``R_base_sensor``: (n, 3, 3).

    Returns:
        (n,) ids from 0; a reading belongs to the first one within :data:`ALIKE_RAD`, not to a neighbour of a
        neighbour, so that a slow turn is not one orientation.
    """
    down, alike = R_base_sensor[:, 2, :], np.cos(ALIKE_RAD)
    out = np.full(len(down), -1, dtype=np.int64)
    count = 0
    for i in range(len(down)):
        if out[i] < 0:
            # By the direction of gravity alone: a turn about the vertical shows the sensor nothing new.
            out[(out < 0) & (down @ down[i] >= alike)] = count
            out[i] = count
            count += 1
    return out


def groups_of(blocks: Sequence[SensorReadings], at_rest: Sequence[bool]) -> tuple[Int, ...]:
    """Groups of readings, within and between files: one for each orientation; groups of the files stay whole.

    ``at_rest``: Of each block, whether its rows are single orientations; motions keep groups of their own. Returns (n,)
    ids for each block.
    """
    keys: list[Int] = []
    used = 0
    shared: dict[int, int] = {}
    for block, resting in zip(blocks, at_rest, strict=True):
        ids, place = np.unique(block.group, return_inverse=True)
        # Files of single readings share ids where they share a posture; those of a motion count its own windows.
        named = [shared.setdefault(int(i), used + k) if resting else used + k for k, i in enumerate(ids)]
        used += len(ids)
        keys.append(np.asarray(named, dtype=np.int64)[place.reshape(-1)])
    resting_blocks = [i for i, resting in enumerate(at_rest) if resting]
    if not resting_blocks:
        return tuple(keys)
    orientation = orientations(np.concatenate([blocks[i].R_base_sensor for i in resting_blocks])) + used
    group = np.concatenate([keys[i] for i in resting_blocks])
    size = int(orientation.max()) + 1
    links = scipy.sparse.coo_matrix((np.ones(len(group)), (group, orientation)), shape=(size, size))
    label = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return tuple(np.asarray(label[key], dtype=np.int64) for key in keys)


def count_of(blocks: Sequence[SensorReadings]) -> int:
    """Number of different groups in all blocks."""
    return len(np.unique(np.concatenate([b.group for b in blocks])))


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

    ``p_seg_com``: (3,) m, its centre of gravity in the body's frame. Returns by index of the segment: kg, and (3,) m in
    its own frame; empty where nothing is behind the sensor.
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
    # The sensor feels one sum: how it is shared among the bodies changes no force, only the sag of what lies between.
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
    w = data.finite(CHANNEL)
    sigma = data.channel(CHANNEL).need_sigma()
    zero = np.zeros((len(data), 3))
    time_s = data.finite("time_s")[:, 0] if data.has("time_s") else np.full(len(data), start_s)
    warmer = data.finite("temperature_c")[:, 0] - reference_c if data.has("temperature_c") else zero[:, 0]
    T_base_sensor = _pose(data, chain, sensor) @ sensor.T_seg_sensor
    R = T_base_sensor[:, :3, :3]
    R_t = np.swapaxes(R, -1, -2)
    if axes_of(data) == "base":
        w = (R_t[:, None] @ w.reshape(-1, 2, 3, 1)).reshape(-1, 6)
        sigma = np.sqrt((R_t[:, None] ** 2 @ sigma.reshape(-1, 2, 3, 1) ** 2).reshape(-1, 6))
    gamma = R_t @ chain.gravity
    R_rest = R
    if sensor.hose_from:
        q = data.finite("q")
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
    return block if data.kind != "sensor_motion" else _in_motion(block, data, time_s, T_base_sensor, window_s)


def _in_motion(
    block: SensorReadings, data: Dataset, time_s: Float, T_base_sensor: Float, window_s: float
) -> SensorReadings:
    """Readings of a motion, smoothed, with rates and accelerations of the sensor."""
    _in_time(data, time_s)
    R, R_t = block.R_base_sensor, np.swapaxes(block.R_base_sensor, -1, -2)
    step_s = float(np.median(np.diff(time_s)))
    width = max(2 * round(0.5 * window_s / step_s) + 1, _ORDER + 2)
    if width > len(data):
        raise FileFormatError(
            "the recorded motion is shorter than the window that smooths it",
            where=data.where or data.name,
            value=f"{len(data)} samples",
            limit=f">= {width}",
        )
    smooth = partial(_smooth, width, step_s)
    rate = smooth(R.reshape(-1, 9), 1).reshape(R.shape)
    spin = 0.5 * (R_t @ rate - np.swapaxes(R_t @ rate, -1, -2))
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    if data.has("accelerometer_sensor"):
        gamma = -smooth(data.finite("accelerometer_sensor"), 0)
    elif not data.has("q"):  # a rotation alone has no place: it would be differentiated to an acceleration of zero
        raise FileFormatError(
            "nothing in the data tells the acceleration of the sensor",
            where=data.where or data.name,
            limit="channel q or accelerometer_sensor",
        )
    else:
        gamma = block.gamma - (R_t @ smooth(T_base_sensor[:, :3, 3], 2)[:, :, None])[:, :, 0]
    block = replace(
        block,
        w_sensor=smooth(block.w_sensor, 0),
        sigma=block.sigma / np.sqrt(width / 3.0),
        gamma=gamma,
        omega=omega,
        alpha=smooth(omega, 1),
        group=np.arange(len(data), dtype=np.int64) // (_WINDOWS * width),
    )
    keep = np.zeros(len(data), dtype=np.bool_)
    # Every half window: readings nearer to each other share most of their samples and are no measurements of their own.
    keep[width : len(data) - width : max(1, width // 2)] = True
    # A window that reaches into the next group holds readings of both: it would be predicted from itself.
    row, half = np.arange(len(data), dtype=np.int64), width // 2
    keep &= (row - half) // (_WINDOWS * width) == (row + half) // (_WINDOWS * width)
    return block.subset(keep)


def _smooth(width: int, step_s: float, values: Float, derivative: int) -> Float:
    out: Float = scipy.signal.savgol_filter(values, width, _ORDER, deriv=derivative, delta=step_s, axis=0)
    return out


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

    Raises InputError: fewer than three directions of gravity.
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
        return carrier_pose(chain, sensor.segment, data.finite("q"))
    index = segment_index(chain, sensor.segment)
    for name, T_seg_known in (("R_base_flange", None), ("R_base_tcp", chain.T_last_tcp)):
        if data.has(name):
            R = data.finite(name)
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


def _in_time(data: Dataset, time_s: Float) -> None:
    if not data.has("time_s") or np.any(np.diff(time_s) <= 0.0):
        raise FileFormatError(
            "a recorded motion needs rising times",
            where=data.where or data.name,
            hint="Map [channels.time_s]; for single orientations use the kind sensor_poses",
        )
