"""Standard tests of robots and machines from raw measurements: ISO 9283, ISO 230-4, straightness."""
