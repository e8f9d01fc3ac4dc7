"""``python -m counterflex``: the command line without its script."""

from __future__ import annotations

from counterflex.cli.start import run

if __name__ == "__main__":
    run()
