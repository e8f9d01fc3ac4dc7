from typing import Final

from counterflex.api.cell import Cell as Cell
from counterflex.api.cell import compliance as compliance
from counterflex.api.cell import deflection as deflection
from counterflex.api.cell import forward as forward
from counterflex.api.cell import inverse as inverse
from counterflex.api.cell import read_cell as read_cell
from counterflex.api.errors import CounterflexError as CounterflexError
from counterflex.api.examples import examples as examples
from counterflex.api.identification import identify as identify
from counterflex.api.identification import propose as propose
from counterflex.api.modes import modes as modes
from counterflex.api.part import Part as Part
from counterflex.api.part import compare as compare
from counterflex.api.part import inspect as inspect
from counterflex.api.part import prove as prove
from counterflex.api.plan import Plan as Plan
from counterflex.api.plan import choose_posture as choose_posture
from counterflex.api.plan import compensate as compensate
from counterflex.api.plan import preflight as preflight
from counterflex.api.process import engagement as engagement
from counterflex.api.process import forces as forces
from counterflex.api.program import Program as Program
from counterflex.api.program import read_program as read_program
from counterflex.api.run_log import RunLog as RunLog
from counterflex.api.run_log import read_run as read_run
from counterflex.api.simulated_cell import SimulatedCell as SimulatedCell
from counterflex.api.simulated_cell import simulate as simulate

__all__: tuple[str, ...]
__version__: Final[str]
