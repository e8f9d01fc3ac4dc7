"""Reads the G-code of TwinCAT NC I (DIN 66025)."""
