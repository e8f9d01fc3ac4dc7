"""Ways in which the tool of a cell may follow a further correction, before and after parts were measured."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.units import UM
from counterflex.evaluate.path_error.learning import Following
from counterflex.plan.measured_correction import ENTRY_LEAD_S, LEAD_S, lead_s, leaving_share
from counterflex.plan.static_correction import LoadedRobot

# Standard deviations of how the tool follows a further correction, beside what the lead counts on: axes that turn back
# are held by friction and play until their integrators have answered. Set on the groove, tuning seeds 1 to 3 of
# ``wide``, whose next parts lie in the interval. Wider gains (0.1, 0.2) doubled the expected part 2.
GAIN: Final = 0.07
WINDOW_GAIN: Final = 0.1
DELAY_S: Final = 0.015
ENTRY_DELAY_S: Final = 0.04
EXIT_DELAY_S: Final = 0.02
ASIDE_M: Final = 25.0 * UM


def following_of(loaded: LoadedRobot) -> Following:
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
    return Following(
        time_s,
        run,
        np.stack([*gains, *(none for _ in late)]),
        np.stack([*(none for _ in gains), *late]),
        ASIDE_M,
    )
