"""Tests of every input before it is used, and of every effect after: signs, frames, sensors, axis angles."""
