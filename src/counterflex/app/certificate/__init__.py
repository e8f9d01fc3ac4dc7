"""Calibration certificates: their values in a cell file or a manifest, and results as documents of that form."""
