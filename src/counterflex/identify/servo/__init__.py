"""Recipe ``servo``: gains of the drives, lowest mode, lags."""
