"""The strains of an instrumented holder as process wrench at the TCP, cycle by cycle, on the bent arm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import carray

from counterflex.core.array_table import ArrayTable, addresses, matrix, reals, to_pointer, wholes
from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, records
from counterflex.core.units import MICRO
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.records import REGION, STATION, SURROUNDINGS, Compact
from counterflex.runtime.sensing.sensor_wrench import CARRIED, bent_rotation, carried_sensor
from counterflex.runtime.sensing.strain_kernel import HOLDER, OBSERVED, begin, observe
from counterflex.runtime.state.states import Cause
from counterflex.sensing.flange_sensor import IDLE, FlangeSensor
from counterflex.sensing.strain_holder import StrainHolder, force_matrix, tool_matrix
from counterflex.sensing.wrench_kernel import idle, to_tcp

ARRAYS: Final = addresses(
    *("stations", "surroundings", "regions", "frame", "delta", "carried", "constants"),
    *("holder", "observed", "strain", "warm", "times", "still", "held", "w_base", "w_part"),
)
_NOTHING, _INVALID = int(Cause.NONE), int(Cause.FORCE_INVALID)
_PATIENCE: Final = 3
"""Cycles in a row in which bridges contradict each other before the force is given up; meanwhile it stands still."""
_UNTARED_N, _UNTARED_UM_M = 1000.0, 50.0


@dataclass(frozen=True)
class ObserverTuning:
    """Settings of the filter of an instrumented holder, beside the holder's constants."""

    # (3,) N, standard deviation of the force's walk over one second, holder axes
    slew_n: tuple[float, float, float] = (1000.0, 1000.0, 1000.0)
    wander: float = 0.02 * MICRO  # standard deviation of each zero's walk over one second, strain
    zero: float = 0.1 * MICRO  # standard deviation of each zero since it was taken before the cut, strain
    share: float = 0.04  # of the largest strain that may contradict the other bridges
    step_s: float = 1e-3  # between samples, where the clock of the amplifier does not tell
    most_sigma_n: float = 60.0  # standard deviation of the force in its worst direction above which it is not used
    least: int = 4  # bridges without which there is no force

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InputError: A number that is not above zero.
        """
        for name in ("wander", "zero", "share", "step_s", "most_sigma_n"):
            as_positive(f"holder: {name}", getattr(self, name))
        for value in self.slew_n:
            as_positive("holder: slew_n", value)


@kernel("int64(Arrays[::1], float64[::1], int64)", Arrays=ARRAYS, entry=True)
def strain_wrench(tables: Records, q: Float, count: int) -> int:
    """Process wrench of a cycle's samples; see :meth:`StrainWrench.__call__`.

    Args:
        tables: (1,) ARRAYS; what the filter remembers and the wrench in base and in part axes are written.
        q: (6,) rad.
        count: Samples that are new.

    Returns:
        As :func:`counterflex.runtime.sensing.strain_kernel.observe`.
    """
    table = tables[0]
    stations, surroundings, regions = table.stations, table.surroundings, table.regions
    chain = Compact(
        carray(to_pointer(stations.place), (stations.rows,), STATION),
        carray(to_pointer(surroundings.place), (1,), SURROUNDINGS),
        carray(to_pointer(regions.place), (regions.rows,), REGION),
    )
    sensors, w_base = carray(to_pointer(table.constants.place), (1,), IDLE), reals(table.w_base)
    carried = carray(to_pointer(table.carried.place), (1,), CARRIED)[0]
    holders = carray(to_pointer(table.holder.place), (1,), HOLDER)
    observeds = carray(to_pointer(table.observed.place), (1,), OBSERVED)
    h, o, still, held = holders[0], observeds[0], reals(table.still), reals(table.held)
    R = carried.R_base_sensor[:]
    bent_rotation(chain, carried, q, w_base, matrix(table.frame), matrix(table.delta))
    idle(sensors, R, carried.R_rest[:], carried.gravity[:], 0.0, math.nan, still)
    for k in range(h.bridges):
        total = 0.0
        for i in range(6):
            total += h.sensitivity[k, i] * still[i]
        o.weight[k] = total
    outcome = observe(holders, observeds, matrix(table.strain), reals(table.warm), wholes(table.times), count)
    p = carried.p_sensor_tcp[:]
    fx, fy, fz = o.x[0], o.x[1], o.x[2]
    held[0], held[1], held[2] = fx, fy, fz
    held[3], held[4], held[5] = p[1] * fz - p[2] * fy, p[2] * fx - p[0] * fz, p[0] * fy - p[1] * fx
    for i in range(6):
        still[i] = 0.0
    to_tcp(held, still, R, p, carried.unturned[:], w_base)
    to_tcp(held, still, R, p, carried.R_base_part[:], reals(table.w_part))
    return outcome


class StrainWrench:
    """The samples of one cycle as process wrench, with buffers that are allocated once.

    Args:
        chain: Elastic chain of the cell.
        holder: Identified constants; its ``segment`` carries the holder's frame.
        T_base_part: (4, 4) part frame.
        stream: Arrays that a receiver fills: strain (m, >= n), temperature (m,) deg C, time (m,) ns, NaN is nothing;
            and (1,) how many rows of them are new.
        shown: (6,) N, where force and its standard deviation in holder axes are written for the log.
        load: Mass behind the holder, kg, and its centre of gravity (3,) m in the holder frame.
        error: (3, 3) standard deviation of the force shown along x, y, z (rows) by 1 N along x, y, z (columns).
        tools: Tool tip (3,) m in the holder frame by tool number; empty: that of the cell.

    Attributes:
        w_part: (6,) N, N m: result, a pure force on the tool at its tip, part axes.
        w_base: (6,) the same in base axes; the load that the next cycle's bending is taken from.
        doubt: Cause why the force cannot be used, or 0.
        tool: Number of the tool in use, or None.
        noise: (n,) standard deviation of a sample, strain.
        observed: What the filter remembers, OBSERVED.

    Raises:
        InputError: The holder's body is not there, or lies before the last axis, or a direction is not determined.
    """

    def __init__(
        self,
        chain: ElasticChain,
        holder: StrainHolder,
        T_base_part: Float,
        stream: tuple[Float, Float, Int, Int],
        shown: Float,
        *,
        load: tuple[float, Float],
        error: Float,
        tools: Mapping[int, Float] | None = None,
        tuning: ObserverTuning | None = None,
    ) -> None:
        tuning = ObserverTuning() if tuning is None else tuning
        self.tuning = tuning
        carrier = FlangeSensor(holder.segment, np.eye(4), load[0], load[1])
        self._carried_records = carried_sensor(chain, carrier, T_base_part)
        self._carried: Record = self._carried_records[0]
        p_tcp = self._carried.p_sensor_tcp.copy()
        self._points: dict[int | None, Float] = {None: p_tcp}
        self._points |= {number: as_float("tool tip", p, (3,)) for number, p in (tools or {}).items()}
        self._gains = {number: tool_matrix(holder.sensitivity, p) for number, p in self._points.items()}
        n = len(holder.gauges)
        self.noise: Float = holder.noise
        for gain in self._gains.values():
            force_matrix(gain, np.diag(self.noise**2))  # refuses a direction that no bridge sees
        self._holder = _packed(holder, tuning, as_float("error", error, (3, 3)))
        self._observed = records(OBSERVED)
        self.observed: Record = self._observed[0]
        self.observed.warm_c = math.nan
        self.w_part: Float = np.zeros(6)
        self.w_base: Float = np.zeros(6)
        self.doubt = _NOTHING
        self.tool: int | None = None
        self._shown, self._bridges, self._tared = shown, n, False
        self._force: Float = self.observed.x[:3]
        self._sigma: Float = self.observed.sigma
        strain, warm, times, self._counts = stream
        self._most = len(strain)
        self._load = carrier.record()
        compact = chain.compact
        m = len(compact.stations) - 1
        self._table = ArrayTable(
            ARRAYS,
            stations=compact.stations,
            surroundings=compact.surroundings,
            regions=compact.regions,
            frame=np.zeros((m + 1, 12)),
            delta=np.zeros((m, 6)),
            carried=self._carried_records,
            constants=self._load,
            holder=self._holder,
            observed=self._observed,
            strain=strain,
            warm=warm,
            times=times,
            still=np.zeros(6),
            held=np.zeros(6),
            w_base=self.w_base,
            w_part=self.w_part,
        )
        self.use(None)
        begin(self._holder, self._observed, _UNTARED_N, _UNTARED_UM_M)

    def __call__(self, q: Float, *_: object) -> Float:
        """Process wrench of the samples that came since the last call.

        Args:
            q: (6,) rad.
            _: What another sensor's reading needs; the samples are in the arrays of the receiver.
        """
        outcome = strain_wrench(self._table.rows, q, min(int(self._counts[0]), self._most))
        self._shown[:3], self._shown[3:] = self._force, self._sigma
        contradicts = outcome == 2 and self.observed.contradicting >= _PATIENCE
        vague = outcome == 0 and max(self._sigma) > self.tuning.most_sigma_n
        wrong = outcome == 1 or (self._tared and (contradicts or vague))
        self.doubt = _INVALID if wrong else _NOTHING
        return self.w_part

    def matrix(self, bridges: Bool) -> Float:
        """(3, m) N: weighted least-squares M of the tool in use, force in holder axes from strain (eq. 8).

        Args:
            bridges: (n,) those that are used, m of them.

        Raises:
            InputError: They do not determine a direction.
        """
        return force_matrix(self._gains[self.tool][bridges], np.diag(self.noise[bridges] ** 2))

    @property
    def mean(self) -> Float:
        """(n,) mean strain of the last cycle, bias, temperature and weight taken off; NaN of a bridge without one."""
        o, n = self.observed, self._bridges
        out: Float = np.where(o.counted[:n] > 0.0, o.level[:n] * MICRO, np.nan)
        return out

    def use(self, tool: int | None) -> None:
        """Take the matrix and the lever of a tool; the zeros stay.

        Args:
            tool: Its number; None and numbers without a tip of their own: the tool of the cell.
        """
        self.tool = tool if tool in self._gains else None
        self.observed.gain[: self._bridges] = self._gains[self.tool] / MICRO
        self._carried.p_sensor_tcp = self._points[self.tool]

    @property
    def R_base_holder(self) -> Float:
        """(3, 3) of the last cycle."""
        out: Float = self._carried.R_base_sensor.reshape(3, 3).copy()
        return out

    def carry(self, mass_kg: float, p_sensor_com: Float) -> None:
        """Take another load behind the holder: that of the tool in use.

        Args:
            mass_kg: Whole mass.
            p_sensor_com: (3,) m, its centre of gravity in the holder frame.
        """
        load: Record = self._load[0]
        load.mass, load.com = mass_kg, p_sensor_com

    def forget_zero(self) -> None:
        """Judge nothing by the zeros until new ones are taken; until then those of before hold."""
        self._tared = False

    def take_zero(self, zero: Float) -> None:
        """Take mean strains without a load as zero, and begin anew.

        Args:
            zero: (n,) strain; a bridge without a number keeps the one it had.
        """
        n = self._bridges
        self.observed.zero[:n] = np.where(np.isfinite(zero), zero / MICRO, self.observed.zero[:n])
        self._tared = True
        begin(self._holder, self._observed, 1.0, self.tuning.zero / MICRO)


def _packed(holder: StrainHolder, tuning: ObserverTuning, error: Float) -> Records:
    n, out = len(holder.gauges), records(HOLDER)
    h: Record = out[0]
    h.sensitivity[:n] = holder.sensitivity / MICRO
    h.bias[:n], h.kelvin[:n] = holder.bias / MICRO, holder.per_kelvin / MICRO
    h.noise[:n] = (holder.noise / MICRO) ** 2
    h.wander[:n] = (tuning.wander / MICRO) ** 2
    h.slew[:] = np.square(tuning.slew_n)
    h.error[:] = error.reshape(-1)
    h.drift[:n] = 5.0 * tuning.zero / MICRO
    h.reference_c, h.share, h.step_s = holder.reference_c, tuning.share, tuning.step_s
    h.bridges, h.least = n, min(tuning.least, n)
    if n < 3:
        raise InputError("bridges of the holder", value=n, limit=">= 3")
    return out
