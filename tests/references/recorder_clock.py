"""Clock of another recorder, for records of which one is stamped by it."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float


@dataclass(frozen=True)
class RecorderClock:
    """Run of another clock: ``stamp = t + offset + drift (t - reference)`` for an instant t of the first clock."""

    offset_s: float = 0.0  # by how much the other clock is ahead at the reference, s
    drift: float = 0.0  # relative rate, 1 (1e-6 is one microsecond in a second)
    reference_s: float = 0.0  # instant at which `offset_s` holds

    def stamps(self, time_s: Float) -> Float:
        """Stamps of the other clock at instants (n,) of the first."""
        out: Float = time_s + self.offset_s + self.drift * (time_s - self.reference_s)
        return out

    def instants(self, stamps_s: Float) -> Float:
        """Instants (n,) of the first clock at stamps (n,) of the other; the inverse of :meth:`stamps`."""
        out: Float = self.reference_s + (stamps_s - self.offset_s - self.reference_s) / (1.0 + self.drift)
        return out
