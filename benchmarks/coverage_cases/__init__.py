"""Seeded truths for each recipe, with and without what the recipe's own model lacks."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "references"))
