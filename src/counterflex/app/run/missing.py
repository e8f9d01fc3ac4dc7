"""Missing parts of a run log: segments cut short, stretches that cannot be read, cycles without a record."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from counterflex.core.errors import FileFormatError
from counterflex.evaluate.missing_cycles import MissingCycles, MissingFinder
from counterflex.files.logs.segments import LogSegment, segments
from counterflex.files.summary_file import read_summary
from counterflex.runtime.record_ring import CYCLE


def counted(folder: str | Path) -> tuple[int, int]:
    """Records of all runs of a folder, and the cycles that each run misses by its own count.

    Raises:
        FileFormatError: There is none, or it cannot be read.
    """
    records, missing = 0, LogMissing()
    for segment in segments(folder):
        records += len(segment.rows)
        missing.add(segment)
    return records, missing.end(folder).missing


def _written(folder: str | Path) -> dict[int, int]:
    """Cycles that the last run of a folder had, by what it said itself at its end; nothing where it did not come to it.

    A file that ends early looks like that of a run that was killed: only who wrote it knows how long it was. Where the
    recorder died the run counted less than there was, never more.
    """
    try:
        summary = read_summary(Path(folder) / "summary.json")
        return (
            {int(summary["run"]): int(summary["records"]) + int(summary["records_lost"])}
            if summary["job"] == "run"
            else {}
        )
    except (FileFormatError, KeyError, TypeError, ValueError):
        return {}


@dataclass(frozen=True)
class Damaged:
    """A stretch of a segment that cannot be read.

    Attributes:
        segment: Name of the file.
        begin: First byte.
        end: First byte behind it.
        after: Last cycle before it; 0 where it is the beginning of the run.
        missing: Cycles between the records around it.
    """

    segment: str
    begin: int
    end: int
    after: int
    missing: int


@dataclass(eq=False)
class LogMissing:
    """Takes the segments of a folder in order, also where those of several runs alternate; then call :meth:`end`.

    Attributes:
        cut: Segments that were cut short or are being written.
        empty: Segments of which nothing can be read.
        damage: Stretches that cannot be read.
        gaps: Cycles without a record, by run.
        at_end: Cycles that are known to be missing behind the last record of each run.
    """

    cut: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    damage: list[Damaged] = field(default_factory=list)
    gaps: dict[int, list[MissingCycles]] = field(default_factory=dict)
    at_end: dict[int, int] = field(default_factory=dict)
    _finders: dict[int, MissingFinder] = field(default_factory=dict)
    _cycle: dict[int, int] = field(default_factory=dict)
    _records: dict[int, int] = field(default_factory=dict)

    def add(self, segment: LogSegment) -> None:
        """Take the next segment."""
        if not segment.about:
            self.empty.append(segment.name)
            return
        if not segment.finished:
            self.cut.append(segment.name)
        run, cycles = segment.run, segment.rows[:, CYCLE]
        for stretch in segment.damage:
            at = stretch.after
            before = int(cycles[at - 1]) if at else self._cycle.get(run, 0)
            missing = segment.lost_at_end if at == len(cycles) else max(0, int(cycles[at]) - before - 1)
            self.damage.append(Damaged(segment.name, stretch.begin, stretch.end, before, missing))
        finder = self._finders.setdefault(run, MissingFinder())
        if segment.digest is None:
            finder.add(segment.rows)
        else:
            sums = segment.digest.sums
            gaps = [MissingCycles(*gap) for gap in sums["gaps"]]
            finder.join(segment.rows, gaps, int(sums["missing"]))
        self.at_end[run] = segment.lost_at_end
        self._records[run] = self._records.get(run, 0) + segment.records
        if len(cycles):
            self._cycle[run] = int(cycles[-1])

    def end(self, folder: str | Path) -> LogMissing:
        """All segments were taken.

        Args:
            folder: They are of; what its run said at its end tells how much is missing where a file ends early.
        """
        for run, written in _written(folder).items():
            if run in self._finders:
                missing = written - self._records[run] - self._finders[run].total
                self.at_end[run] = max(self.at_end[run], missing)
        for run, finder in self._finders.items():
            finder.end(self.at_end[run])
            self.gaps[run] = finder.gaps
        return self

    @property
    def missing(self) -> int:
        """Cycles without a record, of all runs; a cut end is not known and not counted."""
        return sum(finder.total for finder in self._finders.values())

    @property
    def incomplete(self) -> bool:
        """Something within the log is missing or cannot be read; a cut end alone is what every killed run leaves."""
        return bool(self.missing or self.damage or self.empty)

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "cut": self.cut,
            "unreadable": self.empty,
            "damage": [
                {
                    "segment": one.segment,
                    "bytes": [one.begin, one.end],
                    "after_cycle": one.after,
                    "missing_cycles": one.missing,
                }
                for one in self.damage
            ],
            "missing_cycles": self.missing,
            "gaps": [
                {"run": run, "after_cycle": gap.after, "missing_cycles": gap.count, "time_s": round(gap.time_s, 3)}
                for run, gaps in self.gaps.items()
                for gap in gaps
            ],
        }

    def lines(self) -> list[str]:
        """Name missing parts, a sentence each; nothing where nothing is."""
        out = [
            f"damaged: {one.segment}, bytes {one.begin} to {one.end - 1} cannot be read: "
            + (f"{one.missing} cycles missing after cycle {one.after}" if one.missing else "no cycle is missing there")
            for one in self.damage
        ]
        out += [f"nothing of {name} can be read" for name in self.empty]
        known = {(one.after, one.missing) for one in self.damage}
        for run, gaps in self.gaps.items():
            where = f" of run {run}" if len(self.gaps) > 1 else ""
            out += [
                f"{gap.count} cycles missing after cycle {gap.after}{where}"
                + (f": {gap.time_s:.3f} s without a record" if gap.time_s else "")
                for gap in gaps
                if (gap.after, gap.count) not in known
            ]
        if self.missing:
            out.append(f"{self.missing} cycles missing in all")
        return out
