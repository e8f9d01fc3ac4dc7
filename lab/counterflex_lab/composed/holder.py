"""The strain-gauge spindle holder of the stories: what its bridges truly show, and what becomes of their datagrams."""

from __future__ import annotations

import functools
import struct
from dataclasses import replace
from typing import Any, Final

import numpy as np

from counterflex.app.run.holder import force_sigma
from counterflex.core.arrays import Float
from counterflex.core.units import MICRO
from counterflex.files.cell.sensing import HolderTable, strain_holder
from counterflex.protocols.session.standing import SessionChecks
from counterflex.protocols.session.strain_tare import SIGMAS, StrainTare
from counterflex.protocols.strain.link import StrainLink
from counterflex.protocols.strain.telegram import HEAD, MAGIC
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.runtime.settings import OnlineSettings
from counterflex.sensing.carrier import carrier_pose, carrier_to_tcp
from counterflex.sensing.strain_holder import StrainHolder, tool_matrix
from counterflex.twin.plant.strain_holder import NOISE, REFERENCE_C, WANDER, InstrumentedHolder, instrumented_holder
from counterflex_lab.composed import bench
from counterflex_lab.composed.line import damaged
from counterflex_lab.composed.story import Active
from counterflex_lab.composed.wires import VirtualInbox
from counterflex_lab.faults.demonstration import Q, demo_cell
from counterflex_lab.reproduce import holder_case

_SEGMENT: Final = "sensor"
"""Body of the demonstration cell in whose place the holder sits."""
_EPOCH_NS: Final = 7_000_000_000
_SAMPLE_NS: Final = 1_000_000
_LABORATORIES: Final = 8
_CALIBRATED: Final = 0.01
"""Standard deviation of an identified sensitivity, as a share."""


@functools.cache
def table() -> HolderTable:
    """The table of the cell file."""
    return HolderTable(**{**holder_case.cell_table()["holder"], "segment": _SEGMENT})


def true_holder(seed: int) -> InstrumentedHolder:
    """The holder as it is, one of eight.

    Args:
        seed: Of the story.
    """
    return _of_laboratory(seed % _LABORATORIES)


@functools.cache
def _of_laboratory(number: int) -> InstrumentedHolder:
    return instrumented_holder([(*g.p_holder_gauge, g.angle_rad, g.factor) for g in known().gauges], number)


@functools.cache
def known() -> StrainHolder:
    """The holder by its drawing, its tip that of the cell."""
    drawn = strain_holder(table())
    if drawn is None:
        raise AssertionError
    return replace(drawn, p_holder_tcp=carrier_to_tcp(demo_cell().chain, _SEGMENT)[:3, 3], reference_c=REFERENCE_C)


def identified(seed: int) -> StrainHolder:
    """The holder as it was identified."""
    true = true_holder(seed)
    share = _CALIBRATED * np.random.default_rng([seed, 6]).standard_normal(true.sensitivity.shape)
    return replace(known(), sensitivity=true.sensitivity * (1.0 + share), bias=true.zero, per_kelvin=true.per_kelvin)


def opened(seed: int, inbox: VirtualInbox, checks: SessionChecks) -> dict[str, Any]:
    """Receiver, filter and zero of the holder, as a session takes them.

    Args:
        seed: Of the story.
        inbox: Its datagrams.
        checks: Of the session.
    """
    holder = identified(seed)
    link = StrainLink("", 0, len(holder.gauges), range_=table().range_um_m * MICRO, inbox=inbox)
    wrench = StrainWrench(
        demo_cell().chain,
        holder,
        bench.program().T_base_part,
        (link.strain, link.warm_c, link.times_ns, link.counts),
        link.w_sensor,
        load=(0.0, np.zeros(3)),
        error=np.diag([_CALIBRATED] * 3),
    )
    tare = StrainTare(wrench, checks.force_n, checks.moment_nm, table().zero_um_m * MICRO)
    return {"force": link, "wrench": wrench, "tare": tare}


def with_uncertainty(settings: OnlineSettings, seed: int) -> OnlineSettings:
    """Limits widened by what the holder leaves uncertain, as :func:`counterflex.app.run.holder.with_uncertainty`."""
    holder = identified(seed)
    sigma = float(np.max(force_sigma(table(), holder, holder.p_holder_tcp)))
    tests = settings.plausibility
    wider = replace(tests, idle_n=tests.idle_n + SIGMAS * sigma, step_n=tests.step_n + SIGMAS * sigma)
    return replace(settings, plausibility=wider, force_noise_n=float(np.hypot(settings.force_noise_n, sigma)))


class Bridges:
    """The amplifiers' end.

    Args:
        seed: Of the story.
        active: Faults that act.
        rng: Its chance.
        samples: In a cycle.
    """

    def __init__(self, seed: int, active: Active, rng: np.random.Generator, samples: int) -> None:
        true, holder = true_holder(seed), known()
        R = carrier_pose(demo_cell().chain, _SEGMENT, Q, elastic=False)[:3, :3].T @ bench.program().T_base_part[:3, :3]
        self._per_n: Float = tool_matrix(true.sensitivity, holder.p_holder_tcp) @ R / MICRO
        self._zero: Float = true.zero / MICRO
        self._active, self._rng, self._samples = active, rng, samples
        self._wander: Float = np.zeros(len(self._zero))
        self._order = rng.permutation(len(self._zero))
        self._drift: Float = np.zeros(len(self._zero))
        self._direction: Float = rng.standard_normal(len(self._zero))
        self._shown: Float | None = None
        self._sequence = 0
        self._pack = struct.Struct(f"<{len(self._zero)}d").pack

    def samples(self, force: Float) -> list[bytes]:
        """Datagrams of a cycle.

        Args:
            force: (3,) N on the tool, part axes.
        """
        now, size, rng = self._active.now, self._active.size, self._rng
        n = len(self._zero)
        noise = rng.standard_normal((self._samples + 1, n))
        self._wander += WANDER / MICRO * (self._samples * 1e-3) ** 0.5 * noise[-1]
        strain = self._per_n @ force + self._zero + self._wander + NOISE / MICRO * noise[:-1]
        status = 0
        if now:
            strain, status = self._falsified(strain, now)
        out = []
        for row in strain.tolist():
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
            stamp = _EPOCH_NS + self._sequence * _SAMPLE_NS
            data = HEAD.pack(MAGIC, self._sequence, stamp, status, n, REFERENCE_C) + self._pack(*row)
            if "strain-silent" in now or ("strain-lost" in now and rng.random() < size("strain-lost")):
                continue
            if "strain-damaged" in now and rng.random() < size("strain-damaged"):
                data = damaged(data, rng)
            out.append(data)
        return out

    def _falsified(self, strain: Float, now: dict[str, Any]) -> tuple[Float, int]:
        size, out, status = self._active.size, strain, 0
        if "strain-unit" in now:
            out = out * size("strain-unit")
        if "strain-offset" in now:
            out = out + size("strain-offset") * self._direction
        if "strain-drift" in now:
            self._drift += size("strain-drift") * self._samples * 1e-3 * self._direction
        else:
            self._drift[:] = 0.0
        out = out + self._drift
        if "strain-saturated" in now:
            out[:, self._order[: round(size("strain-saturated"))]] = 4000.0
        if "strain-broken" in now:
            broken = self._order[: round(size("strain-broken"))]
            out[:, broken] = np.nan
            status = sum(1 << int(k) for k in broken)
        if "strain-frozen" in now and self._shown is not None:
            still = self._order[: round(size("strain-frozen"))]
            out[:, still] = self._shown[still]
        else:
            self._shown = out[-1].copy()
        return out, status
