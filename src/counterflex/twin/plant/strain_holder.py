"""The instrumented spindle holder of the simulated laboratory, with the faults that real ones have.

The structure is a frame of beams (:mod:`.strain_frame`); gauges sit a little off, their factors scatter, bolted joints
and glue give hysteresis (slip elements on each bridge's strain), temperature leaves a rest, amplifiers add noise and a
slow wander.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.units import DEG, MM, UM
from counterflex.geometry.rotation import skew
from counterflex.twin.plant.strain_frame import HolderShape, StrainFrame, strain_frame

SAMPLE_S = 1e-3
"""Sampling of the bridge amplifiers."""
NOISE, WANDER = 0.22e-6, 0.015e-6
"""Standard deviation of a sample; of the wander over one second."""
PLACE_M, ANGLE_RAD, FACTOR_SHARE, NOTCH_SHARE = 0.4 * MM, 1.0 * DEG, 0.01, 0.05
KELVIN = 0.05 * UM
HYSTERESIS_SHARE, HYSTERESIS_AT = 0.004, (0.5e-6, 2.0e-6, 6.0e-6)
REFERENCE_C = 22.0
FORCE_N = 0.5
"""Noise of the reference dynamometer."""
PAPER_GAUGES = tuple((side * 0.0875, side * y * MM, 0.09, 0.0, 2.0) for side in (-1.0, 1.0) for y in (10.0, -10.0, 7.5))
"""Six bridges in notches half way up the outer faces of the cheeks, along them: a layout that makes the matrix and the
errors what Denkena2015 prints; the paper's own places were lost with its figures."""
PAPER_TCP_M = (0.07, 0.0, 0.42)
"""Tool tip that goes with it, holder frame."""


@dataclass(frozen=True, eq=False)
class InstrumentedHolder:
    """A holder as it truly is.

    Attributes:
        sensitivity: (n, 6) 1/N, 1/(N m): what the bridges truly show per load about the holder's origin.
        zero: (n,) strain shown with no load.
        per_kelvin: (n,) 1/K.
    """

    frame: StrainFrame
    sensitivity: Float
    zero: Float
    per_kelvin: Float

    def still(self, force: Float, p_holder_load: Float) -> Float:
        """(m, n) strain without hysteresis, noise and temperature of forces (m, 3) N at points (m, 3) m."""
        f, p = np.atleast_2d(force), np.broadcast_to(p_holder_load, np.atleast_2d(force).shape)
        w = np.concatenate([f, np.cross(p, f)], axis=1)
        out: Float = w @ self.sensitivity.T
        return out

    def record(
        self,
        force: Float,
        p_holder_load: Float,
        temperature_c: Float,
        rng: np.random.Generator,
        step_s: float = SAMPLE_S,
    ) -> Float:
        """(m, n) what the amplifiers show along a history of load, each sample the mean over its step.

        Args:
            force: (m, 3) N in time order, from rest.
            p_holder_load: (3,) or (m, 3) m.
            temperature_c: (m,) deg C.
            rng: Of the noise.
            step_s: Between samples; longer ones average more noise.
        """
        s = self.still(force, p_holder_load)
        s = s + hysteresis(s) + self.zero + np.outer(np.asarray(temperature_c) - REFERENCE_C, self.per_kelvin)
        wander = np.cumsum(rng.standard_normal(s.shape), axis=0) * WANDER * np.sqrt(step_s)
        out: Float = s + wander + NOISE * np.sqrt(SAMPLE_S / step_s) * rng.standard_normal(s.shape)
        return out


def hysteresis(strain: Float) -> Float:
    """(m, n) what slip elements add to strains (m, n) along their history: stops at some sizes of strain.

    Each stop follows the strain until it slips; together they open a loop of about :data:`HYSTERESIS_SHARE` of the
    range.
    """
    limit = np.array(HYSTERESIS_AT)[:, None]
    residual, out = np.zeros((len(limit), strain.shape[1])), np.empty_like(strain)
    steps = np.diff(strain, axis=0, prepend=0.0)
    for k in range(len(strain)):
        residual = np.minimum(np.maximum(residual + steps[k], -limit), limit)
        out[k] = residual.sum(axis=0)
    return np.asarray(HYSTERESIS_SHARE * out, dtype=np.float64)


def instrumented_holder(
    gauges: Sequence[Sequence[float]] | Float, seed: int, shape: HolderShape | None = None
) -> InstrumentedHolder:
    """The holder of a laboratory.

    ``gauges``: Per bridge where it is meant to sit: x, y, z m, angle rad, notch factor. ``shape``: Structure; None is
    the reference holder.
    """
    frame = strain_frame(shape if shape is not None else HolderShape())
    places = as_float("gauges", gauges, (None, 5))
    rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-holder-1:{seed}").getrandbits(64)))
    off = PLACE_M * rng.standard_normal((len(places), 3))
    turn = ANGLE_RAD * rng.standard_normal(len(places))
    factor = (1.0 + FACTOR_SHARE * rng.standard_normal(len(places))) * (1.0 + NOTCH_SHARE * rng.standard_normal(1))
    nu = frame.shape.poisson_ratio
    rows = []
    for place, d, da, k in zip(places, off, turn, factor, strict=True):
        p = place[:3] + d
        p[2] = np.clip(p[2], 0.0, frame.shape.length_m)
        along, across = frame.strain(p, place[3] + da), frame.strain(p, place[3] + da + 0.5 * np.pi)
        rows.append(k * place[4] * (along - across) / (1.0 + nu))
    return InstrumentedHolder(
        frame=frame,
        sensitivity=np.array(rows),
        zero=20e-6 * rng.standard_normal(len(places)),
        per_kelvin=KELVIN * rng.standard_normal(len(places)),
    )


def compliance_at(frame: StrainFrame, p_holder_tcp: Float) -> Float:
    """(3, 3) m/N of the tool tip by the holder alone, the spindle rigid."""
    p = np.asarray(p_holder_tcp, dtype=np.float64)
    G = np.concatenate([np.eye(3), skew(p)])
    arm = p - np.array([0.0, 0.0, frame.shape.length_m])
    out: Float = np.concatenate([np.eye(3), -skew(arm)], axis=1) @ frame.compliance @ G
    return out
