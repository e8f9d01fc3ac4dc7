"""What a run and a simulated cell import and compile, for a process that others are forked from."""

import counterflex.app.run.process
import counterflex.app.run.recorder
import counterflex.app.simulated_cell.cell  # noqa: F401
from counterflex.protocols.session.session import compile_kernels

compile_kernels()
