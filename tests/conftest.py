"""Tests depend on no machine's speed: hypothesis sets no deadline, small matrices are not shared between threads."""

from __future__ import annotations

import os

from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("COUNTERFLEX_PROGRESS_S", "0")  # how slow a machine is shows in no output
settings.register_profile("counterflex", deadline=None)
settings.load_profile("counterflex")
