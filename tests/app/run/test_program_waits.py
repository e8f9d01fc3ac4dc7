"""What a made KRL program waits for comes from the loop and from the controller, over sockets, in this order."""

from __future__ import annotations

import numpy as np

from counterflex.core.units import MM
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.make.files import RsiFiles
from counterflex.integrations.kuka.link.whole_setup import OnlineLimits
from counterflex.protocols.processes.control_array import Request
from counterflex_lab.faults.rig import Rig

LIMITS = OnlineLimits(2.0, 0.3, 1.5, 4)
NEAR_ZERO_MM = 0.005  # what CF_ZERO compares with


def told(rig: Rig) -> tuple[bool, bool]:
    """Whether the program would go on: "armed" before the path, "at zero" behind it."""
    state = float(rig.robot.reported_state)
    corrected = float(np.abs(rig.robot.correction[:3]).max()) / MM
    return 1.5 < state < 2.5, state <= 2.5 and corrected <= NEAR_ZERO_MM


def test_armed_before_the_path_and_at_zero_behind_it() -> None:
    text = RsiFiles("counterflex", "192.168.1.10", 49152, "ImFree", LIMITS).ethernet()
    with Rig(seed=3, config=parse_config(text.encode(), "made")) as rig:
        rig.enable = False
        rig.run(400)
        assert told(rig) == (False, True)  # it runs, but nobody has armed it: the program stays where it is
        rig.control[Request.ARM] = 1
        rig.run(50)
        assert told(rig)[0]
        rig.enable = True
        rig.run(10)
        rig.feed = True  # the path begins, and a force with it
        for _ in range(1000):
            rig.run(1)
            if np.linalg.norm(rig.robot.correction) > 0.1 * MM:
                break
        assert np.linalg.norm(rig.robot.correction) > 0.1 * MM
        assert told(rig) == (False, False)
        rig.enable = False
        seen = []
        for _ in range(400):
            rig.run(1)
            seen.append((told(rig)[1], float(np.abs(rig.robot.correction[:3]).max()) / MM))
        first = next(k for k, (gone, _) in enumerate(seen) if gone)
        assert first > 10  # it takes its time
        assert max(corrected for _, corrected in seen[first:]) <= NEAR_ZERO_MM  # and then it stays away
