"""Tests depend on no machine's speed: hypothesis sets no deadline."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("counterflex", deadline=None)
settings.load_profile("counterflex")
