"""Imported by the process that commands are forked from."""

from loaded_commands import load

load()
