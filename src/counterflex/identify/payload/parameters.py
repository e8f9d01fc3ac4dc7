"""Parameters of a flange sensor and its payload, in the order in which residuals read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MINUTE
from counterflex.geometry import rotation
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.sensing.flange_sensor import FlangeSensor, turned
from counterflex.sensing.orientation_basis import COUNTS

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
UNITS = ("N", "N", "N", "N m", "N m", "N m")
BIAS, MASS, COM, TURN = slice(0, 6), 6, slice(7, 10), slice(10, 13)
DRIFT, KELVIN, INERTIA, OFFSET = slice(13, 19), slice(19, 25), slice(25, 31), 31
_ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")
_HOUR = 60.0 * MINUTE


@dataclass(frozen=True)
class Knowledge:
    """What is known before: one standard deviation each.

    Attributes:
        bias_n: Force with no load.
        bias_nm: Moment with no load.
        mass_share: Of the mass in the cell file, relative.
        mass_kg: Where the cell file has less than this, it is the standard deviation itself.
        com_m: Centre of gravity, per axis.
        turn_rad: Mounting rotation, per axis.
        drift_n_per_h: Drift of the forces.
        drift_nm_per_h: Of the moments.
        kelvin_n: Temperature coefficient of the forces, N/K.
        kelvin_nm: Of the moments, N m/K.
        offset_n: Size of the orientation-dependent offset of a force, root mean square per function.
        offset_nm: Of a moment.
        inertia_kg_m2: Moments of inertia.
    """

    bias_n: float = 500.0
    bias_nm: float = 100.0
    mass_share: float = 0.5
    mass_kg: float = 20.0
    com_m: float = 0.15
    turn_rad: float = 2.0 * DEG
    drift_n_per_h: float = 10.0
    drift_nm_per_h: float = 2.0
    kelvin_n: float = 2.0
    kelvin_nm: float = 0.5
    offset_n: float = 3.0
    offset_nm: float = 1.0
    inertia_kg_m2: float = 5.0


@dataclass(frozen=True)
class Effects:
    """Which effects the data can tell apart from the rest.

    Attributes:
        degree: Of the orientation-dependent offset, 0 to 2.
        drift: The data span time.
        temperature: The data span temperatures.
        inertia: The data have motion.
    """

    degree: int = 0
    drift: bool = False
    temperature: bool = False
    inertia: bool = False


def parameters(sensor: FlangeSensor, known: Knowledge, effects: Effects) -> Parameters:
    """The parameters around what the cell file says.

    The offset has nominal 0 and its size as prior, so that bias, weight and mounting explain what they can.

    ``effects``: What is free; the rest is held at what the cell file says.
    """

    def six(
        stem: str, unit: str, nominal: Float, force: float, moment: float, label: str, free: bool
    ) -> list[Parameter]:
        return [
            Parameter(
                f"{stem}.{c}",
                u + unit,
                float(value),
                force if i < 3 else moment,
                free=free,
                label=f"{label} {c}",
            )
            for i, (c, u, value) in enumerate(zip(COMPONENTS, UNITS, nominal, strict=True))
        ]

    spread = max(known.mass_share * sensor.mass_kg, known.mass_kg)
    items = six("bias", "", sensor.w_bias, known.bias_n, known.bias_nm, "bias", True)
    items.append(Parameter("mass", "kg", sensor.mass_kg, spread, label="mass behind the sensor"))
    items += [
        Parameter(f"com.{a}", "m", float(v), known.com_m, label=f"centre of gravity {a}")
        for a, v in zip("xyz", sensor.p_sensor_com, strict=True)
    ]
    items += [Parameter(f"mounting.{a}", "rad", 0.0, known.turn_rad, label=f"mounting about {a}") for a in "xyz"]
    force, moment = known.drift_n_per_h / _HOUR, known.drift_nm_per_h / _HOUR
    items += six("drift", "/s", sensor.w_drift_per_s, force, moment, "drift", effects.drift)
    items += six(
        "temperature", "/K", sensor.w_kelvin, known.kelvin_n, known.kelvin_nm, "temperature", effects.temperature
    )
    items += [
        Parameter(f"inertia.{e}", "kg m2", float(v), known.inertia_kg_m2, free=effects.inertia, label=f"inertia {e}")
        for e, v in zip(_ENTRIES, sensor.inertia_kg_m2, strict=True)
    ]
    for k in range(COUNTS[effects.degree]):
        items += six(f"offset{k + 1}", "", np.zeros(6), known.offset_n, known.offset_nm, f"offset {k + 1}", True)
    return Parameters.of(items)


def sensor_of(sensor: FlangeSensor, x: Float, reference_c: float) -> FlangeSensor:
    """The sensor with found values.

    ``sensor``: Of the cell before: body and frame; and where the hose pack was taken to come from. ``x``: (p,) SI
    values in the order of :func:`parameters`.
    """
    return FlangeSensor(
        segment=sensor.segment,
        T_seg_sensor=turned(sensor.T_seg_sensor, x[TURN]),
        mass_kg=float(x[MASS]),
        p_sensor_com=x[COM],
        w_bias=x[BIAS],
        w_drift_per_s=x[DRIFT],
        w_kelvin=x[KELVIN],
        reference_c=reference_c,
        w_offset=x[OFFSET:].reshape(-1, 6),
        inertia_kg_m2=x[INERTIA],
        hose_from=sensor.hose_from if len(x) > OFFSET else "",
    )


def needed() -> tuple[str, ...]:
    """Names of what any use of the sensor has to find first: its zero."""
    return tuple(f"bias.{c}" for c in COMPONENTS)


def seg_frame_com(sensor: FlangeSensor, fit: Fit) -> Float:
    """(3,) m, centre of gravity found, in the frame of the body that carries the sensor."""
    T = sensor.T_seg_sensor
    out: Float = T[:3, 3] + T[:3, :3] @ rotation.exp(fit.values[TURN]) @ fit.values[COM]
    return out
