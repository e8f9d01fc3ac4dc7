from typing import Final

from counterflex.api.cell import (
    Cell as Cell,
    compliance as compliance,
    deflection as deflection,
    forward as forward,
    inverse as inverse,
    read_cell as read_cell,
)
from counterflex.api.errors import CounterflexError as CounterflexError
from counterflex.api.examples import examples as examples
from counterflex.api.identification import identify as identify, propose as propose
from counterflex.api.modes import modes as modes
from counterflex.api.part import Part as Part, compare as compare, inspect as inspect, prove as prove
from counterflex.api.plan import (
    Plan as Plan,
    choose_posture as choose_posture,
    compensate as compensate,
    preflight as preflight,
)
from counterflex.api.process import engagement as engagement, forces as forces
from counterflex.api.program import Program as Program, read_program as read_program
from counterflex.api.run_log import RunLog as RunLog, read_run as read_run
from counterflex.api.simulated_cell import SimulatedCell as SimulatedCell, simulate as simulate

__all__: tuple[str, ...]
__version__: Final[str]
