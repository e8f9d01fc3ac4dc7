"""Begin and end of the command: urgent requests at once, all else by the parser; faults end in one line."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from typing import Final

from counterflex.cli import interrupt
from counterflex.cli.commands.operate import requests
from counterflex.cli.interrupt import end, interruptible
from counterflex.cli.printed import everything_is_text, print_fault
from counterflex.core.errors import CounterflexError, Interrupted
from counterflex.core.system_fault import system_fault

_INTERRUPTED: Final = 130
"""Status that the command parser gives an interrupted command."""


def run() -> None:
    """Run the command line; faults of the user's making end in one line on standard error and exit status 2.

    A fault of the program itself is not hidden: it shows its traceback and ends with status 1. A command that a signal
    has asked to end ends with 128 and the signal's number, whatever else happened: 130 Ctrl-C, 143 request to
    terminate, 129 terminal closed.
    """
    # Matrices are small here: on a busy machine the threads of BLAS wait for one another, fifty times longer than they
    # compute. Must be said before NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn; looking for a screen takes 0.2 s
    # Going through the objects of all libraries once more at the end took a third of a short command, and every 700
    # new ones, while modules are loaded, a twentieth.
    atexit.register(gc.freeze)
    gc.set_threshold(50_000)
    sys.excepthook = print_fault
    with interruptible(), everything_is_text():
        try:
            interrupt.end_with_starter()
            status = _done(sys.argv[1:])
            sys.stdout.flush()  # a full disk behind it is told here
        except KeyboardInterrupt:
            status = _INTERRUPTED
        except Interrupted as fault:
            end(str(fault), interrupt.status() or _INTERRUPTED)
        except CounterflexError as fault:
            end(str(fault))
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(0)
        except BaseException as fault:
            if isinstance(fault, (SystemExit, GeneratorExit)):
                raise
            known = system_fault(fault)  # of a disk, a device, a socket: of the computer, not of the program
            if known is None:
                raise
            end(f"{known.filename or 'counterflex'}: {known.strerror}")
        signal_status = interrupt.status()  # 128 and the number of the signal, whatever the command made of it
    if status == _INTERRUPTED:
        end(f"interrupted; {interrupt.result_text()}", signal_status or _INTERRUPTED)
    if signal_status is not None:
        sys.exit(signal_status)
    sys.exit(status if isinstance(status, int) else 0)


def _done(words: Sequence[str]) -> object:
    """Do what is asked; version and requests to a run without the command parser."""
    if list(words) == ["--version"]:
        from counterflex import __version__
        from counterflex.core.build_data import sentence

        print(sentence(__version__))
        return 0
    status = requests.quick(words)
    return _parsed(words) if status is None else status


def _parsed(words: Sequence[str]) -> object:
    from counterflex.cli.main import parsed

    return parsed(words)
