"""Reads RS274/NGC as LinuxCNC does, strictly: lines to words, blocks, modes and motions."""
