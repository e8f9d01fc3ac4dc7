"""Recipe ``servo``: gains of the drives, lowest mode, lags."""

TITLE = "drive lag, loop gains, bandwidth of corrections, from steps"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
