"""Seeds of a benchmark's ``--seeds``, read as the commands read theirs."""

from __future__ import annotations

import argparse

from counterflex.cli import arguments
from counterflex.core.errors import InputError


def seeds_of(text: str) -> list[int]:
    """Seeds of ``5`` (1 to 5) or ``2001-2008,2011``.

    Raises:
        ArgumentTypeError: It says something else; the parser prints it in one line.
    """
    try:
        return arguments.seeds(text)
    except InputError as fault:
        raise argparse.ArgumentTypeError(str(fault).removeprefix("--seeds: ")) from fault
