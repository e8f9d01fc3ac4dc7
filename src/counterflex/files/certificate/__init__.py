"""Digital calibration certificates (DCC of PTB, XML): quantities read with their uncertainties, results written."""
