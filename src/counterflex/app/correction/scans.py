"""Scans for ``correct``: deviations of a measured part, or the folder of a simulated one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.plan_of_cell import require_same_cell
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import JudgedRun, judge, reference_of
from counterflex.core import file_content
from counterflex.core.arrays import Bool, Float, Float32
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.next_command import next_command
from counterflex.core.units import MM, UM, plain
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.inspection.part_deviations import FLOOR, WALL, PartDeviations
from counterflex.evaluate.path_error.contacts import Contacts
from counterflex.evaluate.path_error.estimate import PathError
from counterflex.evaluate.path_error.explanations import Explanation
from counterflex.evaluate.path_error.learning import Learned, MeasuredError, surface_now
from counterflex.evaluate.surface import NominalSurface
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.part_deviations import MeasuredPart, read_part_deviations
from counterflex.files.summary_file import read_run
from counterflex.plan.plan import Plan

NOISE_M: Final = 20.0 * UM
"""Standard deviation of a single place: structured light."""
PITCH_M: Final = 0.5 * MM
"""Mean distance of places on floors; walls are sampled as finely as the nominal surface has points on them."""


def simulated_scan(
    surface: NominalSurface | None, judged: JudgedRun, *, seed: int, noise_m: float = NOISE_M, pitch_m: float = PITCH_M
) -> PartDeviations:
    """Scan a simulated part.

    Args:
        noise_m: Standard deviation of the noise, independent from place to place.

    Returns:
        Deviations in the axes of the path; rows in no order of the path, as a scanner's.

    Raises:
        InputError: The tool turns in the cut.
    """
    rng = np.random.default_rng(seed)
    if surface is None or judged.surface is None:
        raise InputError(
            "the tool turns in the cut, and such a simulated part has no surface to scan yet",
            hint="Programs with one direction of the tool are corrected",
        )
    floor, wall = judged.surface.floor_m, judged.surface.wall_m
    known: Bool = np.isfinite(floor)
    known &= rng.random(floor.shape) < (surface.nominal.cell_m / pitch_m) ** 2
    j, i = np.nonzero(known)
    nominal = surface.nominal
    at = np.stack([nominal.x0_m + i * nominal.cell_m, nominal.y0_m + j * nominal.cell_m, nominal.z[j, i]], axis=1)
    on = np.isfinite(wall)
    out = np.pad(-surface.wall_normal[on], ((0, 0), (0, 1)))
    points = np.concatenate([at, surface.wall_point[on]])
    normals = np.concatenate([_upward(surface, floor)[j, i], out])
    deviation = np.concatenate([floor[j, i].astype(np.float64), wall[on]])
    face = np.concatenate([np.full(len(at), FLOOR), np.full(len(out), WALL)])
    order = rng.permutation(len(points))
    noisy = deviation + noise_m * rng.standard_normal(len(points))
    sigma = np.full(len(points), noise_m)
    return PartDeviations(points[order], normals[order], noisy[order], sigma, face[order])


def _upward(surface: NominalSurface, floor: Float32) -> Float:
    """(ny, nx, 3) unit normals of the nominal floors, out of the material."""
    z = np.where(np.isfinite(floor), surface.nominal.z.astype(np.float64), np.nan)
    slope = [np.nan_to_num(np.gradient(z, surface.nominal.cell_m, axis=axis)) for axis in (1, 0)]
    normal = np.stack([-slope[0], -slope[1], np.ones_like(z)], axis=-1)
    out: Float = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return out


DEVIATIONS: Final = "deviations.parquet"
"""File of a folder that ``inspect`` wrote."""
_PROVEN: Final = ("compensated.parquet", "compensated-surface.npz")
_PARQUET: Final = b"PAR1"


@dataclass(frozen=True, eq=False)
class PartScan:
    """A measured part."""

    deviations: PartDeviations
    part: MeasuredPart  # Where they come from
    simulated: bool  # Scanned on a simulated part, with the noise of a scanner

    @classmethod
    def read(cls, path: Path, program: Path, job: Job, cell: Cell, number: int) -> PartScan:
        """Read the deviations of a part.

        Args:
            path: File of ``inspect``, its folder, or a folder of ``simulate`` or ``prove``.
            program: The program that the part was to be made by.
            number: Of the scan, so that simulated ones have noise of their own.

        Raises:
            FileFormatError: It is none of these.
            InputError: It is a part of another program.
        """
        digest = hashlib.sha256(file_content.content(program)).hexdigest()
        run, surface = _simulated_files(path)
        if run is not None and surface is not None:
            _check_original(path, program)
            require_same_cell(read_cell(path / simulate.CELL), cell, path)
            reference = reference_of(job, cell)
            record, _ = read_run(run)
            judged = judge(reference, record, HeightMap.load(surface))
            seed = int(hashlib.sha256(file_content.content(surface)).hexdigest()[:8], 16) + number
            scan = simulated_scan(reference.surface, judged, seed=seed)
            return cls(scan, MeasuredPart(program.name, digest, path.name, "mm", (), 0.0), True)
        file = path / DEVIATIONS if path.is_dir() else path
        if not file.is_file():
            raise FileFormatError(
                "no measured part in this folder",
                where=str(path),
                limit=f"{DEVIATIONS} of counterflex inspect, or the folder of simulate or prove",
            )
        with file_content.readable(file, "part deviations"), file.open("rb") as stream:
            if stream.read(4) != _PARQUET:
                raise FileFormatError(
                    "not a file of part deviations",
                    where=str(file),
                    limit=f"{DEVIATIONS} that inspect writes",
                    hint="A scan is laid on the part first: "
                    + next_command("inspect", "PROGRAM", cell="CELL", scan="FILE", out="DIR")
                    + "; then give DIR instead",
                )
        deviations, part = read_part_deviations(file)
        if part.program_sha256 not in ("", digest):
            raise InputError(
                "the deviations are those of another program's part",
                where=str(file),
                value=f"{part.program}, sha256 {part.program_sha256[:8]}",
                limit=f"{program.name}, sha256 {digest[:8]}",
                hint="Inspect the scan against the original program, not the compensated one",
            )
        R = cell.R_part_plane
        return cls(deviations.turned(None if R is None else R.T), part, False)


def _simulated_files(path: Path) -> tuple[Path | None, Path | None]:
    """Record and height map of a folder of ``simulate`` or ``prove``."""
    for run, surface in ((simulate.RUN, simulate.SURFACE), _PROVEN):
        if (path / run).is_file() and (path / surface).is_file():
            return path / run, path / surface
    return None, None


def _check_original(folder: Path, program: Path) -> None:
    """Refuse a simulated part of another original."""
    originals = [simulate.kept(folder, simulate.ORIGINAL), *sorted((folder / "original").glob("*"))]
    source = next((file for file in originals if file.is_file()), None)
    if source is None or file_content.content(source) != file_content.content(program):
        raise InputError(
            "the simulated part was made by another program",
            where=str(folder),
            limit=f"the original {program.name} (simulate --original)",
        )


@dataclass(frozen=True, eq=False)
class MeasuredScan:
    """A scan and the error of the path that it shows."""

    scan: PartScan
    contacts: Contacts  # Which stretches may have made its places
    estimate: PathError  # Error at the nodes of the path
    error: MeasuredError  # The same at its rows

    def facts(self) -> dict[str, Any]:
        """Figures of a part, shop units."""
        estimate = self.estimate
        return {
            "source": self.scan.part.source,
            "simulated": self.scan.simulated,
            "places": estimate.places,
            "other_places": estimate.others,
            **plain(estimate, "noise_um:1 variance_of_means=inflation:2 outliers_percent=outliers:2"),
            "surface_p997_um": round(surface_now(estimate, self.contacts) / UM, 1),
            **plain(estimate, "explained_percent=explained:1 log_evidence:1"),
            "believed": bool(np.any(estimate.believed)),
            "error_rms_um": round(float(np.sqrt(np.mean(np.sum(estimate.error_m**2, axis=1)))) / UM, 1),
            "lengths_mm": [
                round(1e3 * estimate.prior.narrow_length_m, 1),
                round(1e3 * estimate.prior.wide_length_m, 1),
            ],
        }


@dataclass(frozen=True, eq=False)
class Corrected:
    """Result of the job."""

    plan: Plan
    files: dict[str, str]
    encoding: str
    measured: list[MeasuredScan]
    state: Learned  # Error of the next part without a change, and response of the tool, from all parts
    taken: MeasuredError  # What the next program takes back, and the error that is expected
    explained: list[Explanation]
    job: Job
    cell: Cell  # In the working plane of the program
    change_m: Float  # (n, 3) m, change of the correction at the rows of the path
    summary: dict[str, Any]  # What ``summary.json`` holds
