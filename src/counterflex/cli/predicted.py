"""Names of predicted lengths in what commands print: first the one to plan with, then that of the model, so named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

EXPECTED_UM: Final = "expected um"
"""Column of medians with the range of nine of ten such cells."""
MODEL: Final = "model without its unknowns"
MODEL_UM: Final = f"{MODEL} um"
"""Column of what the cell file alone predicts."""
EXPECTED_NOTE: Final = "Expected: median and range of nine of ten such cells; the model is without their unknowns."
MODEL_NOTE: Final = (
    "Model without its unknowns: stiffness, force constants, play and drives as the cell file has them; cell check "
    "says what each can cost."
)


def expected_text(row: Mapping[str, Any]) -> str:
    """``950 (610 to 1480)`` of a row of a summary; ``not counted`` where its unknowns were not drawn."""
    if row["expected_um"] is None:
        return "not counted"
    median, low, high = row["expected_um"]
    return f"{median:.0f} ({low:.0f} to {high:.0f})"
