"""Bytes of the protocols: telegrams and datagrams to numbers and back. No socket, no clock."""
