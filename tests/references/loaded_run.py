"""What a run and a simulated cell import, compile and read, for a process that others are forked from."""

import sys
from pathlib import Path

import counterflex.app.run.process
import counterflex.app.run.recorder
import counterflex.app.simulated_cell.cell  # noqa: F401
from counterflex.protocols.session.session import compile_kernels

sys.path.append(str(Path(__file__).parents[2] / "tools"))
from loaded_kernels import read_compiled

compile_kernels()
read_compiled()
