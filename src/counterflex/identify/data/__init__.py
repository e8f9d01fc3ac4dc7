"""Measured data in memory: channels, datasets, their checks, and the cell as identification sees it."""
