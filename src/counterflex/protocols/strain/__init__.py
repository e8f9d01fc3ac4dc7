"""Strains of an instrumented spindle holder: a datagram of our own to define, for any amplifier's bridge."""
