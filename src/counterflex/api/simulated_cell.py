"""A simulated cell whose true constants the compensator does not know: machine programs and measure on it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from counterflex.api.cell import Cell, file_of, model_of
from counterflex.api.part import Part
from counterflex.api.plan import Plan
from counterflex.api.program import Program, program_file, reading_of
from counterflex.app.campaign import laboratory
from counterflex.app.campaign.parameter_errors import true_edge_force
from counterflex.app.inputs import in_working_plane, read_job
from counterflex.app.proof import simulate as job
from counterflex.app.proof.truth import truth_of
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Result
from counterflex.core.units import N_PER_MM, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.twin.truth import truth as truths
from counterflex.twin.truth.family import family_of
from counterflex.twin.truth.file import write_truth

if TYPE_CHECKING:
    from counterflex.core.arrays import Float


class SimulatedCell(Result):
    """A cell as it really is: the cell file put off by what is usual when only a catalogue is known.

    Attributes:
        cell: What the controller and the compensator know.
        truth: True constants, SI.
    """

    def __init__(self, cell: Cell | str | Path, *, seed: int | None = 1, family: str = "mild") -> None:
        """Draw a simulated cell.

        Args:
            cell: Cell, or cell file.
            seed: Number of the cell; None is exactly as the cell file says. Seeds below 1000 are for trying.
            family: Of the deviations: ``mild``, ``wide``, ``other`` (docs/twin.md).

        Raises:
            InputError: Axes of the cell have no stiffness, or there is no such family.
        """
        self.cell = cell if isinstance(cell, Cell) else Cell(model_of(cell))
        require_stiffness(self.cell.model)
        self.truth: truths.Truth = truth_of(self.cell.model, seed, family_of(family))

    @property
    def table(self) -> pl.DataFrame:
        """True values by the names that identification gives them: ``name``, ``value``, ``unit``.

        Compliances of the elastic elements (um/kN, urad/kNm) and half of the dead band of each axis (urad).
        """
        rows = [
            {
                "name": f"{body.name}.{direction}",
                "value": float(body.compliance[k]) / (UM_PER_KN if k < 3 else URAD_PER_KNM),
                "unit": "um/kN" if k < 3 else "urad/kNm",
            }
            for body in self.truth.bodies
            for k, direction in enumerate(("tx", "ty", "tz", "rx", "ry", "rz"))
        ]
        rows += [
            {"name": f"axis{k + 1}_half_band", "value": drive.dead_band_rad / URAD, "unit": "urad"}
            for k, drive in enumerate(self.truth.drives)
        ]
        return pl.DataFrame(rows)

    @property
    def summary(self) -> dict[str, Any]:
        """Seed and family."""
        return {"cell": self.cell.name, "seed": self.truth.seed, "family": self.truth.family}

    def edge_force(self, chip_um: Any) -> Float:
        """Return the true force on a millimetre of edge.

        Args:
            chip_um: (n,) chip thicknesses.

        Returns:
            (n, 3) N/mm: cutting, radial, axial.
        """
        chips = np.atleast_1d(np.asarray(chip_um, dtype=np.float64))
        force: Float = true_edge_force(self.truth.cutting, chips * UM) / N_PER_MM
        return force

    def measure(
        self, proposal: str | Path, out: str | Path, *, seed: int = 1, progress: Progress = silent
    ) -> dict[str, Any]:
        """Measure what a proposal asks for, with the noise of real instruments.

        Args:
            proposal: Folder, or file, that :func:`counterflex.propose` wrote.
            out: Folder for the dataset.
            seed: Of the laboratory: where its instruments stand, and their noise.
            progress: Called with the share done, 0 to 1.

        Returns:
            ``manifest`` of the dataset, ``rows``, ``channels``.

        Raises:
            CounterflexError: The simulated cell cannot measure this kind.
        """
        file = Path(proposal)
        with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
            truth = Path(scratch) / "truth.toml"
            write_truth(truth, self.truth)
            file_ = file / "proposal.toml" if file.is_dir() else file
            return laboratory.measure(file_, self.cell.file, truth, out, seed=seed, progress=progress)

    def machine(
        self, program: Program | Plan | str | Path, original: str | Path | None = None, *, progress: Progress = silent
    ) -> Part:
        """Machine a program; see :func:`simulate`."""
        known = self.cell.model
        with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
            if isinstance(program, Plan):
                reading, file = program.reading, program.save_program(scratch)[0]
                begun = program.program
            else:
                reading, file = reading_of(program), program_file(program)
                begun = file
            reference = begun if original is None else Path(original)
            there = in_working_plane(reference, known, reading)
            record = job.machine(read_job(file, there, reading=reading), there, self.truth, progress=progress)
        return Part(reference, there, reading, self.truth, record)

    def _lines(self) -> list[str]:
        about = self.summary
        which = (
            "exactly as its file says" if about["seed"] is None else f"seed {about['seed']} of family {about['family']}"
        )
        return [f"simulated cell: {about['cell']}, {which}"]


def simulate(
    program: Program | Plan | str | Path,
    cell: Cell | str | Path,
    *,
    seed: int | None = 1,
    family: str = "mild",
    original: str | Path | None = None,
    progress: Progress = silent,
) -> Part:
    """Machine a program on a simulated cell.

    Args:
        program: Program, program file, or plan.
        cell: Cell, or cell file.
        seed: Number of the simulated cell; None is exactly as the cell file says.
        family: Of the deviations: ``mild``, ``wide``, ``other`` (docs/twin.md).
        original: Uncompensated program that a compensated one stands for; None: the program itself, or the one that
            the plan began with.
        progress: Called with the share done, 0 to 1; may raise to interrupt.

    Raises:
        CounterflexError: The program cannot be read, or never meets the blank.
    """
    known = cell if isinstance(cell, Cell) else Cell(model_of(file_of(cell)))
    return SimulatedCell(known, seed=seed, family=family).machine(program, original, progress=progress)
