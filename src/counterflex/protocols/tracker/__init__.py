"""The neutral pose datagram of trackers: bytes, receiver, sender of a bridge."""
