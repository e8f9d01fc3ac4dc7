"""The size of a program against what its language holds: motions in a file, length of lines and names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.plan.preflight.row import Row

LINE_LENGTH: Final = "line length"


@dataclass(frozen=True)
class ProgramSize:
    """A program as a controller gets it."""

    language: str  # name of its language
    source: str  # where the limits come from
    points: int  # motions of the whole program
    points_limit: int  # largest number of motions of one file
    # names of its files without endings: the program that is started, and the parts that it calls
    names: tuple[str, ...]
    name_limit: int  # longest name, characters
    written: bool  # it is what `counterflex compensate --as` makes of another program; else it is checked as it stands
    line: int | None = None  # longest line, characters, of a program as it stands; None for one that is written
    line_limit: int = 0  # longest line that the controller reads
    line_number: int = 0  # where it is, 1-based
    # row of the path at the first motion of the longest line, or behind it; None where there is none
    line_point: int | None = None
    foreign: str = ""  # why the robot's controller does not run the language; empty where it may

    def points_row(self) -> Row:
        """Motions of one file."""
        main, *parts = self.names
        over = self.points > self.points_limit
        value, limit = float(self.points), float(self.points_limit)
        if not self.written:
            return Row(
                "program size",
                "warning" if over else "ok",
                value,
                limit,
                "",
                None,
                f"motions in {self.language}, in one file" + (f"; {self.source}" if over else ""),
                advice="Divide the program, or write it anew in parts with counterflex convert" if over else "",
            )
        files = f"{main} calls {len(parts)} files, {parts[0]} to {parts[-1]}" if parts else f"one file, {main}"
        text = f"motions in {self.language} without corrections: {files}"
        return Row("program size", "ok", value, limit, "", None, text)

    def name_row(self) -> Row:
        """Length of the names."""
        longest = max(self.names, key=len)
        over = len(longest) > self.name_limit
        return Row(
            "program name",
            "warning" if over else "ok",
            float(len(longest)),
            float(self.name_limit),
            "",
            None,
            f"characters of {longest}",
            advice=f"Rename it: {self.language} takes {self.name_limit} characters" if over else "",
        )

    def language_row(self) -> Row:
        """Language of the controller."""
        return Row(
            "language of the controller",
            "warning" if self.foreign else "ok",
            what=self.foreign or f"{self.language}; nothing says that the robot's controller runs another language",
            advice="Run it on the controller that it was posted for, or name that maker in [robot.controller_axes]"
            if self.foreign
            else "",
        )


def size_rows(size: ProgramSize) -> list[Row]:
    """Motions per file, length of the names, length of the lines, language of the controller."""
    rows = [size.points_row(), size.name_row()]
    if size.line is None:
        rows.append(Row(LINE_LENGTH, "ok", what="the writer keeps lines short"))
    else:
        over = size.line > size.line_limit
        rows.append(
            Row(
                LINE_LENGTH,
                "warning" if over else "ok",
                float(size.line),
                float(size.line_limit),
                "",
                size.line_point,
                f"characters of line {size.line_number}" + (f"; {size.source}" if over else ""),
                advice="Shorten the comments of this line, or divide it" if over else "",
            )
        )
    return [*rows, size.language_row()]
