"""From a scan to the error of the path, and from the errors of all parts to the next plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.app.correction.scans import MeasuredScan, PartScan
from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, silent
from counterflex.core.units import UM
from counterflex.evaluate.path_error.contacts import Nodes, contacts_of
from counterflex.evaluate.path_error.estimate import path_error
from counterflex.evaluate.path_error.learning import LOCAL, Learned, MeasuredError, ToolResponse, learned
from counterflex.files.cell.cell import Cell
from counterflex.plan.measured_correction import ENTRY_LEAD_S, LEAD_S, lead_s, leaving_share, with_measured
from counterflex.plan.plan import Plan
from counterflex.plan.static_correction import LoadedRobot

LIMIT_M: Final = 1500.0 * UM
"""Largest change of a correction from one part to the next, unless another is allowed."""
LEAST_M: Final = 5.0 * UM
"""A change smaller than this everywhere is none: no robot is as good as that."""
_REACH_M: Final = 200.0 * UM
"""Gap of a stretch to a place up to which it may have made it, besides twice the deviations."""

# Standard deviations of how the tool follows a further correction, beside what the lead counts on: axes that turn back
# are held by friction and play until their integrators have answered. Set on the groove, tuning seeds 1 to 3 of
# ``wide``, whose next parts lie in the interval. Wider gains (0.1, 0.2) doubled the expected part 2.
GAIN: Final = 0.07
WINDOW_GAIN: Final = 0.1
DELAY_S: Final = 0.015
ENTRY_DELAY_S: Final = 0.04
EXIT_DELAY_S: Final = 0.02
ASIDE_M: Final = 25.0 * UM


@dataclass(frozen=True, eq=False)
class CorrectionStep:
    """Correction that the next part is made by."""

    plan: Plan
    further_m: Float  # (n, 3) m, displacement that it takes back besides what the plan before took back
    next_error_m: Float  # (n, 3) m, error that is expected of the next part
    unsure_m: Float  # (j, n, 3) m, patterns of what the tool may do besides, one standard deviation each
    state: Learned
    taken: MeasuredError  # What the next program takes back in all, and the error that it is expected to leave


def measured_error(
    scan: PartScan, plan: Plan, nodes: Nodes, cell: Cell, taken_m: Float, progress: Progress = silent
) -> MeasuredScan:
    """Error of the path that a scan shows.

    Args:
        taken_m: (n, 3) m, what the plan takes back because of earlier parts.

    Raises:
        InputError: Too few places of the scan were made by the program.
    """
    part = scan.deviations
    reach = _REACH_M + 2.0 * float(np.quantile(np.abs(part.deviation_m), 0.99)) if len(part) else _REACH_M
    contacts = contacts_of(plan.path, nodes, cell.cutter, part.points, part.normals, reach)
    estimate = path_error(part, nodes, contacts, progress=progress)
    seen = estimate.seen & estimate.believed[:, None]
    support = np.any(estimate.seen, axis=1)
    rows = [nodes.at_rows(v, plan.path, support) for v in (estimate.error_m, estimate.sigma_m, seen.astype(np.float64))]
    return MeasuredScan(
        scan, contacts, estimate, MeasuredError(taken_m, rows[0], np.maximum(rows[1], 1e-9), rows[2] > 0.5)
    )


def next_step(
    plan: Plan, loaded: LoadedRobot, parts: Sequence[MeasuredError], limit_m: float = LIMIT_M
) -> CorrectionStep:
    """The plan for the next part.

    Args:
        parts: Errors of all parts so far, the last ones made by ``plan``.
        limit_m: Largest change of a correction.

    Raises:
        ModelError: The change, or the whole correction, is beyond its limit.
    """
    following, taken = tool_response_of(loaded), parts[-1].taken_m
    state = learned(parts, following)
    requested = state.best_step(following)
    further = requested if np.max(np.abs(requested), initial=0.0) > LEAST_M else np.zeros_like(requested)
    patterns = following.patterns(further)
    left = state.error_m - further + np.tensordot(state.response, patterns, 1)
    return CorrectionStep(
        with_measured(plan, loaded, further, left, limit_m),
        further,
        left,
        unsure(state, following, further, patterns),
        state,
        MeasuredError(taken + further, left, state.sigma_m, state.seen),
    )


def unsure(state: Learned, following: ToolResponse, further_m: Float, patterns_m: Float) -> Float:
    """(j, n, 3) m, independent patterns of what the tool may do besides after a step, one standard deviation each."""
    size, vectors = np.linalg.eigh(state.covariance)
    response = np.tensordot(vectors.T * np.sqrt(np.maximum(size, 0.0))[:, None], patterns_m, 1)
    aside = following.aside(further_m) * np.broadcast_to(np.eye(3)[:, None, :], (3, *further_m.shape))
    out: Float = state.inflation * np.concatenate([response, aside, LOCAL * further_m[None]])
    return out


def tool_response_of(loaded: LoadedRobot) -> ToolResponse:
    """Ways in which the tool may follow a further correction, with what they are before a part was measured.

    A gain of each axis and one delay on the whole path, and a gain and a delay each of entries and of exits.

    Args:
        loaded: The robot under load along the path.
    """
    time_s, run, contact = loaded.inputs.path.time_s, loaded.feed_run, loaded.cut.contact
    entering = (lead_s(time_s, run, contact) - LEAD_S) / (ENTRY_LEAD_S - LEAD_S)
    leaving = leaving_share(time_s, run, contact)
    whole = np.ones(len(time_s))
    gains = [GAIN * whole[:, None] * axis for axis in np.eye(3)]
    gains += [WINDOW_GAIN * window[:, None] * np.ones(3) for window in (entering, leaving)]
    delays = [(DELAY_S, whole), (ENTRY_DELAY_S, entering), (EXIT_DELAY_S, leaving)]
    late = [size * window[:, None] * np.ones(3) for size, window in delays]
    none = np.zeros((len(whole), 3))
    return ToolResponse(
        time_s,
        run,
        np.stack([*gains, *(none for _ in late)]),
        np.stack([*(none for _ in gains), *late]),
        ASIDE_M,
    )
