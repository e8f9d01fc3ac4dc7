"""Import what the processes of a rig import, and read their kernels, once: they are forks of who has done it."""

import counterflex_lab.faults.process_rig  # noqa: F401
from counterflex.protocols.session.session import compile_kernels

compile_kernels()
