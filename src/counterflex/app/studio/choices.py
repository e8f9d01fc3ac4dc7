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
        """How much less the median is."""
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
    now = None if present is None else _mm(_error(present))
    return ProcessChoice(folder, folder, texts.OF_DEFLECTION, now, _mm(_error(chosen)), takes, f"{folder}/cell.toml")


def _strategy(folder: str, summary: dict[str, Any]) -> ProcessChoice | None:
    """Best way to finish the wall."""
    if not summary["choices"]:
        return None
    best, before = summary["choices"][0], summary["before"]
    now = None if before is None else _mm(_error(before))
    return ProcessChoice(folder, folder, texts.OF_WALL, now, _mm(_error(best)), texts.CUT.format(**best))


def _compensated(folder: str, summary: dict[str, Any]) -> ProcessChoice | None:
    """Compensation of the program, at the feed it chooses or at the programmed one."""
    headline = (summary.get("prediction") or {}).get("headline")
    if headline is None:
        return None
    seconds = summary["prediction"].get("duration_s")
    takes = "" if seconds is None else texts.TAKES_S.format(seconds=seconds)
    return ProcessChoice(folder, folder, texts.OF_PATH, headline["before_mm"], headline["after_mm"], takes)


_READ: Final = {"choice": _posture, "plan strategy": _strategy, "compensate": _compensated}


def _error(row: dict[str, Any]) -> list[float]:
    """Error of a row, um: median and range where its knowledge has one."""
    return list(row.get("expected_um") or [row["deflection_um"]] * 3)


def _mm(values_um: Sequence[float]) -> list[float]:
    return [_MM * value for value in values_um]


def _text(values_mm: Sequence[float]) -> str:
    median, low, high = values_mm
    return f"{median:.3f}" + (f" ({low:.3f} to {high:.3f})" if high > low else "")
