"""Signals over time: continuous signals from samples, causal lags that know their delay, alignment of clocks."""
