"""The error that all functions raise for input that they cannot use."""

from counterflex.core.errors import CounterflexError

__all__ = ("CounterflexError",)
