"""Try a language of robots against the laws that every command relies on."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.conversion import run as convert
from counterflex.app.inputs import AS_IT_IS, Job, read_job
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.units import MM, MM_PER_S, UM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.foreign_language import foreign_language
from counterflex.programs.language import LANGUAGES, Language, object_at
from counterflex.programs.robot_text.program import RobotProgram

_PROGRAM: Final = """G21 G17 G90 G94
T{0} M6
S6000 M3
G0 X0 Y0 Z60
G1 Z50 F600
G61
G1 X20.1234 Y-3.3333
G4 P0.5
M0
G64
G2 X40 Y16.5439 I19.8766 J0.0001
G3 X40 Y16.5439 I5 J0
G1 X60 Y20 Z48 F900
G0 Z60
M5
M30
"""
_STOPS: Final = {(20.12, -3.33, 50.0): True, (60.0, 20.0, 48.0): False}
"""By place in mm: True where the robot stops there."""
_FEED_CHANGE: Final = 0.1
"""Largest change of a feed: that of the length of the corrected path is below 2 %."""
_WAVE_M: Final = 5.0 * MM
"""Length of 1 rad of the correction along the path: short enough that points are added."""
_SHIFT_M: Final = np.array([0.1, -0.07, 0.05]) * MM
_TURN_RAD: Final = np.array([4e-4, -3e-4, 2e-4])
_TOLERANCE_M: Final = 1.0 * UM
_NEAR_M: Final = 3.0 * UM
"""Tolerance of the writer, and the sag of the chords by which both paths are sampled."""
_NEAR_RAD: Final = 1e-5
Outcome = tuple[str, str]
"""A law, and why it does not hold or was not tried; empty where it holds."""


class _LanguageTrial:
    def __init__(self, dialect: str, cell_file: Path, folder: Path) -> None:
        self.dialect, self.language, self.folder = dialect, LANGUAGES[dialect], folder
        self.prompt = self.language.prompt or dialect
        self.cell_file, self.cell = cell_file, read_cell(cell_file)
        self.source = folder / "trial.ngc"
        self.source.write_text(_PROGRAM.format(self.cell.tables.tools[0].number), encoding="ascii")
        self.main: Path | None = None

    def converted(self) -> str:
        """A conversion keeps every point, stop, dwell and process word when it is read back."""
        made = convert(self.source, self.cell_file, self.folder / "whole", self.prompt)
        self.main = self.folder / "whole" / made["files"][0]
        return ""

    def parts(self) -> str:
        """A program that is written in parts is read back as one."""
        convert(self.source, self.cell_file, self.folder / "parts", self.prompt, points_per_file=3)
        return ""

    def stops(self) -> str:
        """The end of a motion under G61 is a stop, one under G64 is none."""
        program = AS_IT_IS.program(self._main(), self.cell)
        assert isinstance(program, RobotProgram), "the reader of a language of robots makes no other"
        places = {tuple(np.round(program.motions[k].p_end / MM, 2).tolist()) for k in program.stops()}
        wrong = [place for place, stop in _STOPS.items() if (place in places) != stop]
        return f"{wrong[0]} is {'no' if _STOPS[wrong[0]] else 'a'} stop" if wrong else ""

    def recognised(self) -> str:
        """The signs tell the language in a file with any ending."""
        text = self._main().read_text(encoding="utf-8").splitlines()
        signs, foreign = self.language.signs, foreign_language(text)
        name = None if foreign is None else foreign.name
        return "" if signs is not None and name == signs.name else f"the text is taken for {name or 'G-code'}"

    def cut_short(self) -> str:
        """A program that ends before its last line is refused."""
        main = self._main()
        lines = main.read_bytes().rstrip().splitlines(keepends=True)
        cut = main.with_name(f"cut{main.suffix}")
        cut.write_bytes(b"".join(lines[:-1]))
        try:
            AS_IT_IS.program(cut, self.cell)
        except CounterflexError:
            return ""
        return f"it is read without its last line: {lines[-1].decode().strip()}"

    def unchanged(self) -> str:
        """Without a correction every byte stays."""
        job = read_job(self._main(), self.cell)
        files = self._in_place(job, *np.zeros((2, len(job.sampled), 3)))
        other = [name for name, text in files.items() if (self._main().parent / name).read_bytes() != text.encode()]
        return f"{other[0]} differs" if other else ""

    def corrected(self) -> str:
        """A correction of every point and of the orientation is read back."""
        job, there = read_job(self._main(), self.cell), self.folder / "corrected"
        there.mkdir()
        way = np.cumsum(np.linalg.norm(np.diff(job.sampled.p_part_tcp, axis=0, prepend=0.0), axis=1))
        shift = _SHIFT_M * (1.0 + 0.5 * np.sin(way / _WAVE_M))[:, None]
        for name, text in self._in_place(job, shift, np.tile(_TURN_RAD, (len(way), 1))).items():
            (there / name).write_bytes(text.encode())
        back = read_job(there / self._main().name, self.cell)
        cut = np.flatnonzero(job.sampled.kind == FEED)
        cut = cut[:: max(1, len(cut) // 300)]
        off_m = _distance(back.sampled.p_part_tcp, (job.sampled.p_part_tcp + shift)[cut])
        feeds, old = ({m.feed_m_s for m in one.program.motions if m.feed_m_s > 0.0} for one in (back, job))
        other = [feed for feed in feeds if min(abs(feed / one - 1.0) for one in old) > _FEED_CHANGE]
        if other:
            return f"a feed became {other[0] / MM_PER_S:g} mm/s"
        turned = rotation.exp(_TURN_RAD) @ _orientations(job)[-1]  # The program holds one orientation
        off_rad = float(np.linalg.norm(rotation.log(_orientations(back) @ turned.T), axis=-1).max())
        near = off_m <= _NEAR_M and off_rad <= _NEAR_RAD
        return "" if near else f"off by {off_m / UM:.3f} um and {off_rad * 1e6:.1f} urad"

    def _main(self) -> Path:
        if self.main is None:
            raise InputError("not tried: no program was written")
        return self.main

    def _in_place(self, job: Job, shift_m: Float, turn_rad: Float) -> dict[str, str]:
        if self.language.in_place is None:
            raise InputError("not tried: the language has no in_place")
        path = CompensatedPath.from_correction(job.sampled, shift_m, turn_rad)
        write = object_at(self.language.in_place)
        files: dict[str, str] = write(job.program, path, tolerance_m=_TOLERANCE_M, cycle_s=1e-3, cell="", job="").files
        return files


def _distance(way: Float, points: Float) -> float:
    """Largest distance of points (k, 3) from a line through places (n, 3), m."""
    step = np.diff(way, axis=0)
    share = np.einsum("pnk,nk->pn", points[:, None] - way[:-1], step) / np.maximum(np.sum(step**2, axis=1), 1e-30)
    nearest = way[:-1] + np.clip(share, 0.0, 1.0)[..., None] * step
    return float(np.linalg.norm(nearest - points[:, None], axis=2).min(axis=1).max())


def _orientations(job: Job) -> Float:
    assert isinstance(job.program, RobotProgram), "the reader of a language of robots makes no other"
    return np.asarray(job.program.Rs_part_tcp)


def trial(dialect: str, cell_file: str | Path) -> list[Outcome]:
    """Try a language, each law of :class:`_LanguageTrial`.

    Args:
        dialect: Of a robot, with ``convert``.
        cell_file: Cell with ``[controller.spindle.<dialect>]`` that gives every function other statements.

    Raises:
        InputError: It is no such language.
    """
    language: Language = LANGUAGES[dialect]
    if not language.robot or language.convert is None:
        raise InputError("a language of robots with convert is tried", value=dialect)
    with tempfile.TemporaryDirectory() as folder:
        tried = _LanguageTrial(dialect, Path(cell_file), Path(folder))
        laws = (
            tried.converted,
            tried.stops,
            tried.parts,
            tried.recognised,
            tried.cut_short,
            tried.unchanged,
            tried.corrected,
        )
        return [(str(law.__doc__), _outcome(law)) for law in laws]


def _outcome(law: Callable[[], str]) -> str:
    try:
        return law()
    except CounterflexError as fault:
        return str(fault)
    except Exception as fault:  # Of the package that is tried
        return f"{type(fault).__name__}: {fault}"
