"""Types of the records that kernels of the loop take, by the names in their signatures.

The arguments bear the same names everywhere: ``given`` the inputs of the cycle, ``settings`` of the loop, ``state``
what the step remembers, ``ring`` the past cycles (PAST rows), ``plan`` (n,) PLAN, ``cycle`` what the stages of the step
hand to each other, ``result`` what is answered; ``limits``, ``memory`` and ``work`` settings, memory and work space of
the plausibility tests.
"""

from __future__ import annotations

from typing import Any, Final

from counterflex.robot.elasticity.kernels.records import ELASTIC, WORK as ELASTIC_WORK
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.doubts import CUT, CUT_KIND, LIMITS, MEMORY, WORK
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.memory import FUSION, PAST, STATE
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.result import RESULT

LOOP_TYPES: Final[dict[str, Any]] = {
    "Given": GIVEN,
    "Settings": SETTINGS,
    "State": STATE,
    "Past": PAST,
    "Fusion": FUSION,
    "Plan": PLAN,
    "Cycle": CYCLE,
    "Result": RESULT,
    "Limits": LIMITS,
    "Memory": MEMORY,
    "Work": WORK,
    "Cut": CUT,
    "Kind": CUT_KIND,
    "Elastic": ELASTIC,
    "ElasticWork": ELASTIC_WORK,
}
"""For ``@kernel("void(Given, Settings)", **LOOP_TYPES)``."""
