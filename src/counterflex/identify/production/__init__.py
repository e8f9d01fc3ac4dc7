"""Constants of the cutting force, and wear, from run logs of ordinary cuts, aligned with their plans."""

TITLE = "force constants and tool wear, from run logs of ordinary cuts"
"""What is estimate, and from what: in the help, in result.json, over the report, in docs/identify.md."""
