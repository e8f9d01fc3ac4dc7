"""From a program and a cell to the compensated program, its plan, figures and what to do next."""
