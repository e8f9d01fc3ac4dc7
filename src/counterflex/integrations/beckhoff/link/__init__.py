"""Beckhoff ADS over TCP: frames, and the client of a TwinCAT."""
