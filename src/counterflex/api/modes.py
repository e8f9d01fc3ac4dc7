"""Natural frequencies of a cell in a posture, and a tap test beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from counterflex.api.cell import Cell, model_of
from counterflex.app import cell_modes
from counterflex.app.pose_questions import checked_joints
from counterflex.core.errors import InputError
from counterflex.core.result import Figure, Result
from counterflex.core.units import UM
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import frequency_response

if TYPE_CHECKING:
    import polars as pl


class Modes(Result):
    """Modes of a cell in a posture.

    Attributes:
        result: Shapes and matrices, SI.
    """

    def __init__(self, result: cell_modes.PostureModes) -> None:
        self.result = result

    @property
    def table(self) -> pl.DataFrame:
        """One row per mode: ``hz``, the interval of nine of ten such robots, and the springs that bend most."""
        import polars as pl

        rows = [
            {
                "mode": k + 1,
                "hz": mode["hz"],
                "from_hz": mode["of_90_percent_hz"][0],
                "to_hz": mode["of_90_percent_hz"][1],
                "springs": ", ".join(f"{spring['name']} {100.0 * spring['share']:.0f} %" for spring in mode["springs"]),
            }
            for k, mode in enumerate(self.summary["modes"])
        ]
        return pl.DataFrame(rows)

    @property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json`` of the command ``modes``."""
        return self.result.summary

    def response(
        self,
        hz: Any,
        *,
        mass_factors: Mapping[str, float] | None = None,
        factor: float = 1.0,
        damping_s: float | None = None,
    ) -> pl.DataFrame:
        """Return the motion of the tool tip under a force there, drives held.

        Args:
            hz: (n,) frequencies.
            mass_factors: Factors on the masses of bodies, by name.
            factor: On all compliances.
            damping_s: beta of the damping beta K; None is that of the cell.

        Returns:
            For each direction ``axis`` of the base and frequency ``hz``: ``real_um_n``, ``imag_um_n`` along the force.

        Raises:
            InputError: There is no body of a name.
        """
        import polars as pl

        modes_, given = self.result, dict(mass_factors or {})
        chain = modes_.chain
        if unknown := set(given) - set(chain.names):
            raise InputError("there is no such body", value=min(unknown), limit=", ".join(chain.names))
        factors = np.array([given.get(name, 1.0) for name in chain.names])
        chain = replace(chain, mass=chain.mass * factors, compliance=chain.compliance * factor)
        frequency = np.atleast_1d(np.asarray(hz, dtype=np.float64))
        M, stiffness, J, _ = matrices(chain, modes_.q)
        beta = modes_.damping_s if damping_s is None else damping_s
        response = frequency_response(M, stiffness, J, beta, (None,) * 6, 2.0 * math.pi * frequency) / UM
        return pl.concat(
            pl.DataFrame(
                {
                    "hz": frequency,
                    "axis": [axis] * len(frequency),
                    "real_um_n": response[:, k, k].real,
                    "imag_um_n": response[:, k, k].imag,
                }
            )
            for k, axis in enumerate("xyz")
        )

    def compare(self, tap_test_file: str | Path, *, up_to_hz: float = cell_modes.UP_TO_HZ) -> dict[str, Any]:
        """Compare with a tap test in the same posture, and fit the masses.

        Args:
            tap_test_file: Columns ``frequency_hz,force,motion,real_um_n,imag_um_n`` in base axes (docs/modes.md).
            up_to_hz: Rows of higher frequency are left out.

        Returns:
            Agreement (FRAC) and modes before and after, ``masses`` with what is known of each.

        Raises:
            CounterflexError: The file is damaged, or has too few rows.
        """
        return cell_modes.beside_tap_test(self.result, tap_test_file, up_to_hz)

    def _lines(self) -> list[str]:
        lowest = self.summary["modes"][0]
        low, high = lowest["of_90_percent_hz"]
        return [
            f"{self.summary['cell']}: lowest mode at {lowest['hz']:.1f} Hz",
            f"nine of ten such robots: {low:.1f} to {high:.1f} Hz",
        ]

    def _pictures(self) -> dict[str, Figure]:
        """``mode1``, ``mode2`` ...: the arm in each mode, from the side and from above."""
        from counterflex.app.cell_modes import page_data
        from counterflex.report.modes_page import mode_figure

        data = page_data(self.result)
        return {
            f"mode{k + 1}": partial(mode_figure, data.points_m, data.moved_m[:, :, k], data.flange)
            for k in range(len(self.summary["modes"]))
        }


def modes(cell: Cell | str | Path, joints_deg: Any = None, *, count: int = cell_modes.COUNT) -> Modes:
    """Return the modes of a cell in a posture.

    Args:
        cell: Cell, or cell file.
        joints_deg: (6,) angles as the controller shows them; None is at the blank.
        count: Number of modes.

    Raises:
        InputError: Axes of unknown stiffness, or nothing that yields.
    """
    known = model_of(cell)
    q = None if joints_deg is None else checked_joints(known.chain, list(joints_deg))
    return Modes(cell_modes.PostureModes.of(known, q, count=count))
