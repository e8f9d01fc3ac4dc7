"""The figures of pages and of the prompt in words; they are defined once, in the evaluate room."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

GLOSSARY: Final = (
    (
        "nominal path",
        "Path of the tool centre in the original program, in the part frame, independent of the commands to the robot.",
    ),
    (
        "path error",
        "Distance of the actual tool centre from the nearest nominal point, in the order of the program; its component "
        "across the feed. Taken every 0.1 mm of path, so that slow and fast stretches have the same weight, over "
        "all feed "
        "motion that removes material. Air moves are reported apart.",
    ),
    ("max", "Largest value."),
    ("99.7 %", "Value that 99.7 % of the path length (of the area, for surfaces) stays below."),
    ("rms", "Root of the mean square over the path length or area."),
    (
        "entry, exit",
        "Path error from first contact until the engagement has reached its plateau, and from where it leaves the "
        "plateau until contact ends; at least one cutter radius each. Part of the overall figures, never cut out.",
    ),
    ("along", "Lag or lead along the feed. Reported, never counted as path error."),
    (
        "surface deviation",
        "Distance of the machined surface from the simulated undisturbed one along the nominal normal, over the floors "
        "and walls that the program machines. Positive = material left. Floors come from the height map, walls from "
        "the exact section of the swept tool path.",
    ),
    ("reduction", "1 - compensated / uncompensated of the same figure, same truth, same seed."),
    (
        "truth level",
        "What the planner knew: 'exact' = the truth's own constants (shows the method's error), 'catalogue' = the "
        "cell file: what is published of robot and material, 'identified' = constants from a measuring campaign.",
    ),
    ("AT_p", "Path accuracy in the sense of ISO 9283: largest distance over all feed motion, in contact or not."),
    (
        "share in the error budget",
        "Component of a predicted contribution along the deviation met, summed over the path, divided by the sum of "
        "the deviation's magnitude. Shares add up to 100 %; a cause that reduces the deviation has a negative "
        "one.",
    ),
)

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


def line_of(row: Mapping[str, Any], *, bare: bool = False) -> str:
    """Return a line of the program as people read it: with its file where the result names one.

    Args:
        row: With ``line``, and ``place`` in programs of several files.
        bare: Only the number, in a column of lines.
    """
    return str(row.get("place") or (row["line"] if bare else f"line {row['line']}"))
