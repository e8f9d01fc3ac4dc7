"""Choices for one program side by side: errors before and after each, and what it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex.app.studio import texts
from counterflex.app.studio.project import Project

_MM: Final = 1e-3
"""Millimetres in a micrometre of the summaries."""


@dataclass(frozen=True)
class ProcessChoice:
    """A choice: errors in mm as median, low and high of nine of ten cells."""

    folder: str
    title: str
    of: str  # quantity that is compared
    now_mm: Sequence[float] | None
    then_mm: Sequence[float]
    takes: str = ""  # what it changes
    cell: str = ""  # cell file that makes the choice; empty: none

    @property
    def gain_percent(self) -> float | None:
        """Share by which the median is smaller; None where the error of now is not known."""
        if self.now_mm is None or self.now_mm[0] <= 0.0:
            return None
        return 100.0 * (1.0 - self.then_mm[0] / self.now_mm[0])

    def row(self) -> list[str]:
        """Texts of a row of the table."""
        gain = self.gain_percent
        now = "" if self.now_mm is None else _text(self.now_mm)
        return [self.title, self.of, now, _text(self.then_mm), "" if gain is None else f"{gain:.0f} %", self.takes]


def choices(project: Project, program: str) -> list[ProcessChoice]:
    """All choices whose results lie in the folder, in the order in which they were computed."""
    out = []
    for folder in project.results(program, *_READ):
        one = _READ[project.job(folder)](folder, project.summary(folder))
        if one is not None:
            out.append(one)
    return out


def _posture(folder: str, summary: dict[str, Any]) -> ProcessChoice | None:
    """Posture or place: what the robot holds, the same cut."""
    chosen, present = summary["chosen"], summary["present"]
    if chosen is None:
        return None
    takes = texts.TURNED.format(branch=chosen.get("branch", ""), turn=chosen.get("rotation_about_tool_deg", 0.0))
    of, now, then = _errors(texts.OF_DEFLECTION, present, chosen)
    return ProcessChoice(folder, folder, of, now, then, takes, f"{folder}/cell.toml")


def _strategy(folder: str, summary: dict[str, Any]) -> ProcessChoice | None:
    """Best way to finish the wall."""
    if not summary["choices"]:
        return None
    best = summary["choices"][0]
    of, now, then = _errors(texts.OF_WALL, summary["before"], best)
    return ProcessChoice(folder, folder, of, now, then, texts.CUT.format(**best))


def _compensated(folder: str, summary: dict[str, Any]) -> ProcessChoice | None:
    """Compensation of the program, at the feed it chooses or at the programmed one."""
    headline = (summary.get("prediction") or {}).get("headline")
    if headline is None:
        return None
    seconds = summary["prediction"].get("duration_s")
    takes = "" if seconds is None else texts.TAKES_S.format(seconds=seconds)
    return ProcessChoice(folder, folder, texts.OF_PATH, headline["before_mm"], headline["after_mm"], takes)


_READ: Final = {"choice": _posture, "plan strategy": _strategy, "compensate": _compensated}


def _errors(
    of: str, now: dict[str, Any] | None, then: dict[str, Any]
) -> tuple[str, Sequence[float] | None, Sequence[float]]:
    """Quantity, and errors before and after, mm: medians and ranges.

    Where one of them was not counted with what is not known, both are those of the model alone; the quantity says so.
    """
    rows = [then] if now is None else [now, then]
    counted = all(row.get("expected_um") for row in rows)
    values = [[v * _MM for v in (row["expected_um"] if counted else [row["deflection_um"]] * 3)] for row in rows]
    return of if counted else texts.OF_MODEL.format(of=of), None if now is None else values[0], values[-1]


def _text(values_mm: Sequence[float]) -> str:
    median, low, high = values_mm
    return f"{median:.3f}" + (f" ({low:.3f} to {high:.3f})" if high > low else "")
