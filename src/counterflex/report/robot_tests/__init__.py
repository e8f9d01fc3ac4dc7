"""Pages of standard tests: ISO 9283, ISO 230-4, straightness."""
