"""A tap test beside the computed modes of a cell, and the masses that explain it best."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.cell_modes import PostureModes
from counterflex.app.lowest_mode import STATED
from counterflex.core.errors import InputError
from counterflex.files.tap_test import read_tap_test
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.plan.modes import driven_modes
from counterflex.plan.tap_fit import MassFit, Tap, fit_masses, frac
from counterflex.robot.elasticity.chain import ElasticChain

UP_TO_HZ: Final = 40.0
"""Beyond, links and motors have modes of their own that the chain does not have."""
_LISTED: Final = 4


def beside_tap_test(done: PostureModes, file: str | Path, up_to_hz: float = UP_TO_HZ) -> dict[str, Any]:
    """Compare the modes of a cell with a tap test in the same posture, and fit its masses.

    Args:
        done: Modes in the posture of the tap test.

    Returns:
        Plain values: agreement before and after, modes before and after, masses with what is known of each.

    Raises:
        FileFormatError: The file is damaged.
        InputError: Too few rows below ``up_to_hz``.
    """
    whole = read_tap_test(file)
    rows = whole.omega_rad_s <= 2.0 * math.pi * up_to_hz
    if not rows.any():
        raise InputError(
            "no row of the tap test is low enough",
            where=str(file),
            value=f"{whole.omega_rad_s.min() / (2.0 * math.pi):.3g} Hz",
            limit=f"<= {up_to_hz:g} Hz",
            hint="Choose --up-to-hz",
        )
    tap = Tap(whole.omega_rad_s[rows], whole.force_base[rows], whole.motion_base[rows], whole.receptance[rows])
    fit = fit_masses(done.chain, done.q, tap, done.damping_s, done.spread.mass, STATED)
    after = fit.applied(done.chain)
    return {
        "file": Path(file).name,
        "rows": int(rows.sum()),
        "up_to_hz": up_to_hz,
        "frac_before": round(frac(tap.receptance, fit.before), 4),
        "frac_after": round(frac(tap.receptance, fit.after), 4),
        "modes_before": _modes(done.chain, done, done.damping_s),
        "modes_after": _modes(after, done, fit.damping_s),
        "damping_s_after": float(f"{fit.damping_s:.4g}"),
        "stiffness_factor": round(fit.stiffness_factor, 4),
        "masses": _masses(done.chain, fit),
    }


def _modes(chain: ElasticChain, done: PostureModes, damping_s: float) -> list[dict[str, float]]:
    M, stiffness = matrices(chain, done.q)[:2]
    listed = driven_modes(M, stiffness, damping_s, chain.servo or (None,) * AXES)[:_LISTED]
    return [{"hz": round(mode.hz, 3), "damping_ratio": round(mode.damping_ratio, 4)} for mode in listed]


def _masses(chain: ElasticChain, fit: MassFit) -> list[dict[str, Any]]:
    """Masses before and after; where the data say nothing, the stated one stays."""
    return [
        {
            "body": chain.names[body],
            "stated_kg": round(float(chain.mass[body]), 2),
            "fitted_kg": round(float(chain.mass[body] * fit.factor[k]), 2),
            "sigma_percent": round(100.0 * float(fit.sigma[k]), 1),
            "seen": bool(fit.seen[k]),
        }
        for k, body in enumerate(np.asarray(fit.bodies).tolist())
    ]
