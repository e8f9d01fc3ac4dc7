from typing import Final

from counterflex.api import (
    choose_posture,
    compare,
    compensate,
    deflection,
    identify_cell,
    inspect_part,
    preflight,
    prove,
    read_cell,
    simulate,
)

__all__ = [
    "choose_posture",
    "compare",
    "compensate",
    "deflection",
    "identify_cell",
    "inspect_part",
    "preflight",
    "prove",
    "read_cell",
    "simulate",
]
__version__: Final[str]
