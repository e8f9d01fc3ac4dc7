"""Force sensor as the online session needs it, whatever it speaks."""

from __future__ import annotations

from typing import Final, Protocol, runtime_checkable

from counterflex.core.arrays import Float

LARGEST: Final = 1e6
"""N and N m beyond which a number is damaged and no reading: it would stay in the filters for minutes."""


@runtime_checkable
class ForceSource(Protocol):
    """Readings of one sensor."""

    w_sensor: Float
    """(6,) N, N m, mean of the good samples since the last :meth:`drain`; always the same array, as the next."""
    samples: Float
    """(m, 6) N, N m, the good samples of the last drain one by one."""

    @property
    def first(self) -> int:
        """Sequence number of the first of them; -1 where they do not come at 1 kHz."""

    @property
    def good(self) -> int:
        """Good samples in the last drain."""

    @property
    def saturated(self) -> bool:
        """One of them was beyond the range, or the sensor said so."""

    @property
    def frozen(self) -> bool:
        """The readings have not changed for a while."""

    def drain(self) -> int:
        """Take every sample that is there; returns the number of good ones."""

    def close(self) -> None:
        """End the stream."""
