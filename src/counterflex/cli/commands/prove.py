"""Commands that prove a compensation: truth, simulate, evaluate, prove, predict, reveal."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, MOST_WORKERS, argument, option
from counterflex.cli.commands.program import AssumeClass, CellFile, MachineOptions, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_folders, keep_inputs, print_summary, progress_bar, say_written
from counterflex.core.errors import InputError
from counterflex.core.result import Lines, ShownTable, fill
from counterflex.core.units import UM
from counterflex.twin.truth.family import FAMILIES

SEEDS = option("--seeds", "Truth seeds: how many, from 1 on, or which: 2001-2008,2011.", metavar="N|A-B,C")
Seeds = Annotated[str, SEEDS]
FamilyName = Annotated[
    str,
    option(
        "--family",
        "How far the simulated cell is from the cell file: mild or wide (docs/twin.md).",
        arguments.one_of(FAMILIES, "family of truths"),
        "FAMILY",
    ),
]
Workers = Annotated[
    int | None,
    option("--workers", "Processes that machine at a time; by default one per core.", min=1, max=MOST_WORKERS),
]


def truth(
    cell: Annotated[Path, argument("The cell file.", arguments.file, "CELL")],
    out: Annotated[Path, option("--out", "Truth file to write.", arguments.output_file, "FILE")],
    seed: Annotated[
        int | None,
        option("--seed", "Random seed of the deviations; without it truth and cell agree.", min=0, max=LARGEST_SEED),
    ] = None,
    family: FamilyName = "mild",
    assume_class: AssumeClass = False,
) -> None:
    """Make a truth file: the parameters of a simulated cell, which differ from the cell file as in a real cell.

    Family mild: each elastic element 10 %, force constants 10 % in common, geometry 0.15 mm per link (one sigma each),
    bearings, masses, runout, friction and play besides. Family wide: elements 30 %, all of them together 20 %, force
    constants 30 % and 20 %, drives 30 %. The file lists every value.

    Example: `counterflex truth cell.toml --seed 1 --out truth.toml`
    """
    keep_inputs(out, cell)
    from counterflex.app.proof.truth import make_truth
    from counterflex.files.cell.cell import read_cell
    from counterflex.twin.truth.family import family_of

    made = make_truth(read_cell(cell, assume_class=assume_class), seed, out, family_of(family))
    say_written(out, f"wrote {out}: {len(made.bodies)} bodies, seed {'none' if seed is None else seed}")


@with_records
def simulate(
    program: Program,
    cell: CellFile,
    truth: Annotated[Path, option("--truth", "Truth file (.toml).", arguments.file, "TRUTH")],
    out: Out,
    original: Annotated[
        Path | None,
        option("--original", "The uncompensated program, reference of a compensated one.", arguments.file, "PROGRAM"),
    ] = None,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Machine a program on the simulated cell.

    Writes into DIR: run.parquet (path, force, every 4 ms), surface.npz (the part), the inputs, summary.json.

    Example: `counterflex simulate out/part.ngc --original part.ngc --cell cell.toml --truth truth.toml --out run`
    """
    keep_inputs(out, program, cell, truth, original, source.parameters)
    from counterflex.app.proof import simulate as job

    reading = source.reading()
    with progress_bar(f"machining {program.name}") as progress:
        summary = job.run(program, cell, truth, out, original=original, reading=reading, progress=progress)
    columns = "time s=duration_s:g | in the cut s=cutting_s:g | peak force N=peak_force_n:g | largest offset mm:g"
    title = fill("{program} machined, seed {seed}", summary)
    print_summary(
        Lines(summary, ShownTable.of(title, columns, [summary["machining"]])), as_json, out, " ({seconds:.1f} s)"
    )


def evaluate(
    folders: Annotated[list[Path], argument("Folders of simulate: before [after].", arguments.folder, "DIR...")],
    out: Annotated[
        Path | None, option("--out", "Write summary.json and report.html here.", arguments.output_folder, "DIR")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Compare machined programs with the original: path, entries, exits, surface.

    The first folder is the uncompensated program, the second the compensated one.

    Example: `counterflex evaluate run-before run-after --out out`
    """
    keep_folders(out, *folders)
    from counterflex.app.proof import evaluate as job

    with progress_bar("judging"):
        summary = job.run(list(folders), out)
    print_summary(job.Evaluated(summary), as_json, out)


def mesh(
    folder: Annotated[Path, argument("Folder of simulate.", arguments.folder, "DIR")],
    out: Out,
    range_um: Annotated[
        float,
        option(
            "--range-um",
            "Deviation of full red (material left) and full blue (gouged).",
            arguments.between(1.0, 10_000.0),
            "UM",
        ),
    ] = 100.0,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Write the machined part as a mesh in the colours of its deviation, and the nominal part beside it.

    Walls are exact, not those of a grid: points on them lie where lines along x and y leave what the tool swept.
    nominal.stl, machined.ply, points.parquet (with the deviation of each point), summary.json.

    Example: `counterflex mesh run-after --out mesh-after`
    """
    keep_folders(out, folder)
    from counterflex.app.proof import mesh as job

    with progress_bar(f"meshing {folder.name}") as progress:
        summary = job.run(folder, out, range_m=range_um * UM, progress=progress)
    table = ShownTable.of(
        fill("deviation of {program} on {cell}, along the normal of the surface", summary),
        "surface | points | 50 %={p50_um:.1f} um~none | 99.7 %={p997_um:.1f} um~none | largest={max_um:.1f} um~none",
        [summary[name] | {"surface": name} for name in ("walls", "floors")],
    )
    print_summary(Lines(summary, table), as_json, out, ": nominal.stl, machined.ply, points.parquet, summary.json")


def report(
    before: Annotated[Path, argument("Folder of simulate: the uncompensated program.", arguments.folder, "BEFORE")],
    after: Annotated[Path, argument("Folder of simulate: the compensated program.", arguments.folder, "AFTER")],
    out: Out,
) -> None:
    """Write the report of two machined programs: one HTML page with maps, curves, tables and what was assumed.

    Example: `counterflex report run-before run-after --out out`
    """
    keep_folders(out, before, after)
    from counterflex.app.proof import evaluate as job

    with progress_bar("writing the report"):
        job.run([before, after], out)
    typer.echo(f"wrote {out / 'report.html'} and summary.json")


@with_records
def prove(
    program: Program,
    cell: CellFile,
    out: Out,
    seeds: Seeds = "1",
    family: FamilyName = "mild",
    exact: Annotated[bool, option("--exact/--no-exact", "Also plan with the truth's exact constants.")] = True,
    assume_class: AssumeClass = False,
    workers: Workers = None,
    *,
    source: MachineOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Compensate a program, machine it before and after on simulated cells, compare, and write the report.

    Example: `counterflex prove part.ngc --cell cell.toml --seeds 5 --out out`
    """
    numbers = arguments.seeds(seeds)
    keep_inputs(out, program, cell, source.parameters)
    from counterflex.app.proof import prove as job
    from counterflex.twin.truth.family import family_of

    with progress_bar(f"proving {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            seeds=numbers,
            family=family_of(family),
            exact=exact,
            assume_class=assume_class,
            workers=workers,
            reading=source.reading(),
            progress=progress,
        )
    _print_proof(summary, out, as_json=as_json)


def _print_proof(summary: dict[str, Any], out: Path, *, as_json: bool) -> None:
    from counterflex.app.proof.evaluate import ProofSummary

    print_summary(ProofSummary(summary), as_json)
    if not as_json:
        typer.echo(f"report: {out / 'report.html'}")


def demo(
    out: Annotated[Path, option("--out", "Folder for the results.", arguments.output_folder, "DIR")] = Path(
        "counterflex-demo"
    ),
    seeds: Seeds = "1",
    family: FamilyName = "mild",
    workers: Workers = None,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Run the complete chain on built-in data: compensate a test part, machine it before and after, compare, report.

    Grooves, ramps and a circular pocket in EN AW-2017 on a KR 300 R2500 ultra (after Haehn and Weigold 2020). Takes
    about two minutes on two cores; --seeds 5 about eight.

    Example: `counterflex demo --out out/demo`
    """
    numbers = arguments.seeds(seeds)
    from counterflex.app import examples
    from counterflex.app.proof import prove as job
    from counterflex.twin.truth.family import family_of

    with tempfile.TemporaryDirectory() as folder, progress_bar("demonstration") as progress:
        cell = Path(folder) / "cell.toml"
        _, part = examples.write(cell)
        summary = job.run(part, cell, out, seeds=numbers, family=family_of(family), workers=workers, progress=progress)
    _print_proof(summary, out, as_json=as_json)


def predict(
    source: Annotated[
        Path,
        argument("Folder of compensate or correct; with --cell manifest of pulls.", arguments.file_or_folder, "PLAN"),
    ],
    out: Annotated[Path, option("--out", "New prediction file.", arguments.output_file, "FILE")],
    cell: Annotated[Path | None, option("--cell", "Cell file, for pulls.", arguments.file, "CELL")] = None,
    as_json: Annotated[bool, option("--json", "Print the prediction as JSON.")] = False,
) -> None:
    """Write what a plan predicts, with 90 % intervals, to a sealed file before anything is machined or measured.

    The file holds figures, digests of program and cell, version, time, and a SHA-256 over all of it. Commit the file,
    or send the printed SHA-256 to somebody: nobody can change the prediction afterwards without being noticed. Then
    machine or measure, and compare with `reveal`.

    Example: `counterflex predict plan --out groove.json`
    """
    from counterflex.app import ledger as job

    made = job.predict(source, cell, out)
    print_summary(made, as_json, out, ", SHA-256 {sha256}: commit it")


def reveal(
    prediction: Annotated[Path | None, argument("File of predict.", arguments.file, "[PREDICTION]")] = None,
    measured: Annotated[
        Path | None,
        argument(
            "Folder of evaluate, prove, inspect or correct; manifest of pulls.", arguments.file_or_folder, "[CAME]"
        ),
    ] = None,
    out: Annotated[Path | None, option("--out", "New file for the pair.", arguments.output_file, "FILE")] = None,
    ledger: Annotated[
        Path | None, option("--ledger", "Instead: list predictions and pairs of a folder.", arguments.folder, "DIR")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print the pair, or the ledger, as JSON.")] = False,
) -> None:
    """Compare a prediction with the measurement that came later: predicted, interval, came, inside or not.

    Refused are a changed prediction, and a measurement of another program or cell, of a part that another program than
    the plan's made, or begun before the prediction was written. Where a measurement does not say when it was made,
    that is printed. --ledger lists all pairs, misses too, and the predictions that nobody has revealed.

    Example: `counterflex reveal groove.json proof --out groove-pair.json`
    """
    from counterflex.app import ledger as job

    if ledger is not None and (prediction, measured, out) == (None, None, None):
        print_summary(job.ledger(ledger), as_json)
    elif prediction is None or measured is None or ledger is not None:
        raise InputError("reveal needs PREDICTION and CAME, or --ledger DIR alone")
    else:
        keep_inputs(out, prediction, measured)
        print_summary(job.reveal(prediction, measured, out), as_json, out)
