"""Flange sensor and instrumented holder of one run, fused."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.app.run.holder import force_sigma, holder_of, open_holder
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.online import OnlineTable
from counterflex.plan.plan import Plan
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.session.pair import PairSource, PairTare
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.sensing.carrier import carrier_to_tcp

_SECOND_S: Final = 1.0


def open_pair(
    cell: Cell,
    table: OnlineTable,
    plan: Plan | None,
    flange: tuple[ForceSource, SensorWrench],
    strains: tuple[str, int],
    force_n: float,
    moment_nm: float,
) -> tuple[PairSource, PairWrench, PairTare]:
    """Both sensors as one source, one wrench, one zero.

    Args:
        cell: With tables ``[sensor]`` and ``[holder]``.
        table: ``[online]``.
        plan: Of the program, or None; it may cut with one tool.
        flange: The flange sensor, and what makes a process wrench of it.
        strains: Address and UDP port of the strain datagrams.
        force_n: Largest force that either may show without a cut.
        moment_nm: Largest moment.

    Raises:
        InputError: Several tools, inertia that is taken out, a part on the robot, or a holder that cannot be used.
        OutputError: The port cannot be opened.
    """
    require_pair(cell, table, plan)
    holder_table, holder = holder_of(cell)
    link, wrench, zero = open_holder(cell, plan, *strains, force_n, moment_nm)
    p_holder_tcp = carrier_to_tcp(cell.chain, holder.segment)[:3, 3]
    still, later = (force_sigma(holder_table, holder, p_holder_tcp, t) for t in (0.0, _SECOND_S))
    x, y, z = np.sqrt(np.maximum(later**2 - still**2, 1e-12))
    tuning = table.pair.tuning((float(x), float(y), float(z)))
    pair = PairWrench(flange[1], wrench, cell.T_base_part, table.period_ms * 1e-3, tuning)
    return PairSource(flange[0], link, pair), pair, PairTare(pair, force_n, moment_nm, zero)


def require_pair(cell: Cell, table: OnlineTable, plan: Plan | None) -> None:
    """Refuse what two sensors do not go with. Raises InputError: see :func:`open_pair`."""
    tools = 1 if plan is None else len(np.unique(plan.path.tool[plan.cutting]))
    for what, value, limit, wrong in (
        ("[online] inertia_hz", table.inertia_hz, "0", table.inertia_hz > 0.0),
        ("[cell] part_on", "flange", "the table", cell.holds_part),
        ("tools of the plan", tools, "1", tools > 1),
    ):
        if wrong:
            raise InputError(
                'force_from = "both" does not go with this',
                where=f"{cell.path}: {what}",
                value=value,
                limit=limit,
                hint='Set force_from = "sensor" or "holder"',
            )
