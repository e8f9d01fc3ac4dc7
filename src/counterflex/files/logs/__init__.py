"""Run logs (MCAP) and text logs of trackers and force sensors."""
