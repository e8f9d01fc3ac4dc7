"""Imported by the process that many commands are forked from."""

from loaded_kernels import read_before_forks

read_before_forks()
