"""How much a command takes at most: numbers beyond are mistyped, and would fill memory or run for ever."""

from __future__ import annotations

from typing import Final

MOST_SEEDS: Final = 100
LARGEST_SEED: Final = 2**31 - 1
MOST_WORKERS: Final = 256
MOST_PROPOSED: Final = 500
"""Measurements that a laboratory could still make."""
MOST_RECORDS: Final = 100_000_000
"""Cycles, samples, datagrams: four days at 4 ms."""
LARGEST_PORT: Final = 65535
