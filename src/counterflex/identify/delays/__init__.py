"""Delay of one channel against another, which ``timing`` and ``servo`` both fit."""
