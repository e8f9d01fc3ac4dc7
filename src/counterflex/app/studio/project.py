"""The folder of a project: which of its files are cells, programs, plans, results and scans."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.app.robot_programs import digest
from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.files.dataset.proposal import PROPOSAL
from counterflex.programs.language import LANGUAGES

SCANS: Final = (".ply", ".stl", ".obj", ".e57", ".las", ".laz", ".pcd", ".ptx", ".csv", ".xyz", ".asc")
"""Endings of files that may be a scan of a part."""
SUMMARY: Final = "summary.json"
_JOBS: Final = {"checks": "preflight", "chosen": "choice"}
"""Jobs by a key of their summary, where it does not name them."""
IDENTIFIED: Final = "result.json"
_HEAD: Final = 4096
"""Bytes at the beginning of a proposal that name its recipe."""
_CELL: Final = "counterflex-cell"
_MOST: Final = 1 << 20
"""Bytes of a file that may be a cell file."""


@dataclass(frozen=True)
class Project:
    """A folder; files are named relative to it, as in the commands that run there."""

    folder: Path

    def cells(self) -> list[str]:
        """Cell files in the folder and one level below, without the copies that proofs keep."""
        return [self.name(path) for path in self._files((".toml",), below=True) if self._is_cell(path)]

    def programs(self) -> list[str]:
        """Programs in the folder itself: those below it are results."""
        endings = {ending for _, one in LANGUAGES.items() if one.read is not None for ending in one.endings}
        return [self.name(path) for path in self._files((*sorted(endings), ".ngc", ".nc", ".tap"))]

    def scans(self) -> list[str]:
        """Files in the folder that may be scans."""
        return [self.name(path) for path in self._files(SCANS)]

    def results(self, program: str, *jobs: str) -> list[str]:
        """Folders of results of jobs for a program, the newest last."""
        folders = []
        for path in sorted(self.folder.glob(f"*/{SUMMARY}"), key=lambda one: one.stat().st_mtime):
            name = self.name(path.parent)
            if self.job(name) in jobs and self.summary(name).get("program") == Path(program).name:
                folders.append(name)
        return folders

    def job(self, folder: str) -> str:
        """Job that has written the summary of a folder; ``choice``: of a posture or a place."""
        summary = self.summary(folder)
        return str(summary.get("job") or next((job for key, job in _JOBS.items() if key in summary), ""))

    def plans(self, program: str) -> list[str]:
        """Folders with a plan for a program, the newest last."""
        return self.results(program, "compensate", "correct")

    def made_with(self, folder: str, cell: str) -> bool:
        """Return whether a folder of results was made with a cell file as it is now."""
        inputs = self.summary(folder).get("inputs")
        made = inputs.get("cell_sha256") if isinstance(inputs, dict) else None
        return not cell or made is None or made == digest(self.folder / cell)

    def forms(self, recipe: str) -> list[str]:
        """Folders with a form of measurements for a recipe, the newest last."""
        mark = f'recipe = "{recipe}"'.encode()
        paths = sorted(self.folder.glob(f"*/{PROPOSAL}"), key=lambda one: one.stat().st_mtime)
        return [self.name(path.parent) for path in paths if mark in file_content.content(path)[:_HEAD]]

    def identified(self, recipe: str) -> list[str]:
        """Folders with values that a recipe has identified, the newest last."""
        paths = sorted(self.folder.glob(f"*/{IDENTIFIED}"), key=lambda one: one.stat().st_mtime)
        names = [self.name(path.parent) for path in paths]
        return [name for name in names if self.identification(name).get("recipe") == recipe]

    def identification(self, folder: str) -> dict[str, Any]:
        """``result.json`` of a folder of identified values; empty where there is none that can be read."""
        return self._values(folder, IDENTIFIED)

    def summary(self, folder: str) -> dict[str, Any]:
        """``summary.json`` of a folder of results; empty where there is none that can be read."""
        return self._values(folder, SUMMARY)

    def _values(self, folder: str, name: str) -> dict[str, Any]:
        try:
            content = file_content.json_value(self.folder / folder / name)
        except (FileFormatError, OSError):
            return {}
        return content if isinstance(content, dict) else {}

    def inside(self, name: str) -> Path | None:
        """A file of the project by its name; None where there is none, or it lies outside."""
        path = (self.folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(self.folder.resolve()) else None

    def name(self, path: Path) -> str:
        """Name of a file or folder in the project."""
        return path.relative_to(self.folder).as_posix()

    def _files(self, endings: tuple[str, ...], *, below: bool = False) -> list[Path]:
        patterns = ("*", "*/*") if below else ("*",)
        paths = [path for pattern in patterns for path in self.folder.glob(pattern)]
        paths = [path for path in paths if path.suffix.lower() in endings and path.is_file()]
        return sorted(path for path in paths if os.fsencode(path).decode("utf-8", "ignore") == str(path))

    def _is_cell(self, path: Path) -> bool:
        try:
            if (path.parent / "nominal.parquet").exists() or path.stat().st_size > _MOST:
                return False
            return f'"{_CELL}"'.encode() in file_content.content(path)
        except (OSError, FileFormatError):
            return False
