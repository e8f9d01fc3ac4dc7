"""Tests depend on no machine's speed: hypothesis sets no deadline, small matrices are not shared between threads."""

from __future__ import annotations

import os
import signal

from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("COUNTERFLEX_PROGRESS_S", "0")  # how slow a machine is shows in no output
settings.register_profile("counterflex", deadline=None)
settings.load_profile("counterflex")

# A shell that starts the suite in the background has it ignore Ctrl-C, and every process that a test starts inherits
# that: none could be interrupted, and what waits for it would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
