"""The six-axis force sensor of the simulated laboratory, with the faults that real ones have.

It is mounted a little turned, reads with gains and cross-talk off by some tenths of a percent, has a zero, a zero that
creeps after switching on (exponential, not linear), a temperature coefficient with a bend, and noise.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.geometry import pose, rotation
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_changes import Hose, hose_of
from counterflex.twin.truth.truth import Truth

BIAS_N, BIAS_NM = 30.0, 4.0
MOUNTING_RAD = 0.4 * DEG
GAIN_SHARE, CROSS_SHARE = 0.002, 0.001
CREEP_N, CREEP_NM, CREEP_S = 3.0, 0.3, 3600.0
KELVIN_N, KELVIN_NM, BEND_PER_K = 0.4, 0.04, 0.02
REFERENCE_C = 20.0


@dataclass(frozen=True, eq=False)
class ForceSensor:
    """A sensor as it truly is."""

    segment: str  # body that carries the sensor frame
    carried: str  # first body on its tool side
    arm: str  # body that the hose pack comes from
    T_seg_sensor: Float  # (4, 4) true frame
    gain: Float  # (6, 6) of the reading on the true wrench
    w_bias: Float  # (6,) N, N m
    w_creep: Float  # (6,) zero after long time minus zero at the start
    w_kelvin: Float  # (6,) per K at the reference temperature
    hose: Hose | None

    def true_wrench(self, plant: Plant, gravity_base: Float) -> Float:
        """(6,) N, N m on the tool side about the true sensor's origin in its axes, of the plant's present state."""
        T_base_sensor = plant.body_pose(self.segment) @ self.T_seg_sensor
        T_sensor_base = pose.inverse(T_base_sensor)
        T_base_carried = plant.body_pose(self.carried)
        w = pose.carry_wrench(T_sensor_base @ T_base_carried, plant.section_wrench(self.carried))
        pack = plant.truth.other.hose
        if pack is not None:  # the hose that loads the arm is the one that the sensor feels
            arm, tool = pack.arm_body, plant.truth.bodies[-1].name
            place, pull = hose_of(pack).on_tool(plant.body_pose(arm), plant.body_pose(tool), gravity_base)
            w = w + pose.carry_wrench(T_sensor_base @ pose.make(p=place), pull)
        elif self.hose is not None:
            place, pull = self.hose.on_tool(plant.body_pose(self.arm), T_base_carried, gravity_base)
            w = w + pose.carry_wrench(T_sensor_base @ pose.make(p=place), pull)
        return w

    def reading(self, w_true: Float, time_s: float, temperature_c: float) -> Float:
        """(6,) what it shows without noise, ``time_s`` after switching on."""
        warm = temperature_c - REFERENCE_C
        out: Float = self.gain @ w_true + self.w_bias + self.w_creep * (1.0 - np.exp(-time_s / CREEP_S))
        return out + self.w_kelvin * warm * (1.0 + BEND_PER_K * warm)


def sensor_place(truth: Truth, segment: str | None = None) -> tuple[str, str, str]:
    """Bodies that carry the sensor, hang behind it, and hold the hose pack.

    ``segment``: Name of the carrier; None takes that of the truth, the body named ``sensor``, else the first behind the
    last axis. Raises InputError: no such body, nothing behind it, or not the one of the truth.
    """
    if truth.sensor is not None:
        if segment not in (None, truth.sensor.segment):
            raise InputError("the truth's sensor sits elsewhere", value=segment, limit=truth.sensor.segment)
        segment = truth.sensor.segment
    names = [b.name for b in truth.bodies]
    last = max(i for i, b in enumerate(truth.bodies) if b.joint is not None)
    if segment is None:
        segment = next((n for n in names[last + 1 :] if "sensor" in n), names[min(last + 1, len(names) - 1)])
    if segment not in names[:-1]:
        raise InputError(
            "no force sensor can sit there", value=segment, limit=f"one of {', '.join(names[last + 1 : -1])}"
        )
    arm = next(b.name for b in truth.bodies if b.joint == 3)
    return segment, names[names.index(segment) + 1], arm


def force_sensor(truth: Truth, seed: int, segment: str | None = None, *, hose_share: float = 1.0) -> ForceSensor:
    """The sensor of a laboratory, turned a little from where the truth says that it is thought to sit.

    Not from where a cell file has it: once that was identified, it holds the turn already.

    ``hose_share``: Size of the hose pack; 0 leaves it out.
    """
    segment, carried, arm = sensor_place(truth, segment)
    rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-force-sensor-1:{seed}").getrandbits(64)))
    six = np.r_[np.full(3, BIAS_N), np.full(3, BIAS_NM)]
    bias = six * rng.standard_normal(6)
    turn = MOUNTING_RAD * rng.standard_normal(3)
    own = np.r_[np.full(3, 1.0), np.full(3, 0.3)]  # a cross term carries N into N m and back
    gain = np.eye(6) + CROSS_SHARE * rng.standard_normal((6, 6)) * own[:, None] / own
    gain[np.diag_indices(6)] += GAIN_SHARE * rng.standard_normal(6)
    creep = np.r_[np.full(3, CREEP_N), np.full(3, CREEP_NM)] * rng.standard_normal(6)
    kelvin = np.r_[np.full(3, KELVIN_N), np.full(3, KELVIN_NM)] * rng.standard_normal(6)
    nominal = np.eye(4) if truth.sensor is None else truth.sensor.T_seg_sensor
    hose = Hose(
        p_arm_clamp=np.array([0.15, 0.05, 0.1]) + 0.03 * rng.standard_normal(3),
        p_tool_clamp=np.array([0.05, 0.0, 0.12]) + 0.03 * rng.standard_normal(3),
        tool_exit=np.array([1.0, 0.0, 0.0]),
    )
    scaled = replace(
        hose,
        mass_kg=hose.mass_kg * hose_share,
        pull_n_m=hose.pull_n_m * hose_share,
        bending_nm=hose.bending_nm * hose_share,
    )
    return ForceSensor(
        segment=segment,
        carried=carried,
        arm=arm,
        T_seg_sensor=nominal @ pose.make(rotation.exp(turn)),
        gain=gain,
        w_bias=bias,
        w_creep=creep,
        w_kelvin=kelvin,
        hose=scaled if hose_share > 0.0 else None,
    )
