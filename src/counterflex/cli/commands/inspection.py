"""The command that judges a real part: ``inspect``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program
from counterflex.cli.commands.standards.options import FORMATS, frame_of
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar, say_written
from counterflex.core.errors import InputError
from counterflex.core.units import MM

if TYPE_CHECKING:
    from counterflex.app.inspection.judging import How
    from counterflex.app.inspection.tool_log import LogHow

_UNITS = ("um", "mm", "cm", "inch", "m")
_POSITIONS = ("measured", "reported", "commanded")
_FACES = ("x-", "x+", "y-", "y+", "bottom", "top")
_one_face = arguments.one_of(_FACES, "datum face")


def datum_faces(param: arguments.Param, value: str | None) -> str | None:
    """Check the names of faces before anything is read."""
    if value is not None:
        _one_face(param, [name.strip() for name in value.split(",")])
    return value


def _measured(
    scan: Path | None, tool_log: Path | None, of_scan: Mapping[str, object], of_log: Mapping[str, object]
) -> Path:
    """The one of scan and log that is given; refuses options of the other."""
    measured = scan or tool_log
    if measured is None or (scan is not None and tool_log is not None):
        raise InputError(
            "nothing measured is given" if measured is None else "a scan and a log of the tool are given",
            where="--scan and --tool-log",
            limit="one of them",
        )
    what, others = ("a scan", of_log) if tool_log is None else ("a log of the tool", of_scan)
    for name, value in others.items():
        if value is not None and value is not False:
            raise InputError(f"{what} has no such option", where=name, hint=f"Leave {name} out")
    return measured


@dataclass(frozen=True)
class ScanOptions:
    """Options by which a scan is read and laid on the part."""

    unit: Annotated[
        str | None,
        option(
            "--unit",
            "Unit of the scan: um, mm, cm, inch, m; by default found from the size of the blank.",
            arguments.one_of(_UNITS, "unit"),
            "UNIT",
        ),
    ] = None
    datum: Annotated[
        str | None,
        option(
            "--datum",
            "Faces of the blank that place the scan: some of x-,x+,y-,y+,bottom,top; by default all scanned ones "
            "that the program does not machine.",
            datum_faces,
            "FACES",
        ),
    ] = None
    datum_points: Annotated[
        Path | None,
        option(
            "--datum-points",
            "Rough pose: lines of scan x,y,z in its unit and part x,y,z in mm, three or more.",
            arguments.file,
            "FILE",
        ),
    ] = None
    aligned: Annotated[bool, option("--aligned", "The scan is in the part frame already; it is not moved.")] = False
    ball_diameter_mm: Annotated[
        float | None,
        option(
            "--ball-diameter-mm",
            "Of the probe, where the points are centres of its ball; 0: they lie on the surface.",
            arguments.between(0.0, 4.0),
            "MM",
        ),
    ] = None
    clearance_mm: Annotated[
        float | None,
        option(
            "--clearance-mm",
            "Points further from the blank, or of what it stands on, are cut away; by default 3.",
            arguments.between(0.1, 100.0),
            "MM",
        ),
    ] = None
    export: Annotated[
        Path | None,
        option(
            "--export",
            "Also write the deviations of a scan as points with scalar fields, mm: .ply or .vtp (VTK).",
            arguments.output_file,
            "FILE",
        ),
    ] = None
    export_frame: Annotated[
        str | None,
        option(
            "--export-frame",
            "Frame of the points of --export: part, or base, the foot of the robot, where --cell places the part; by "
            "default part.",
            arguments.one_of(("part", "base"), "frame"),
            "FRAME",
        ),
    ] = None

    def given(self) -> dict[str, object]:
        """Values by the names of the options."""
        return {f"--{name.replace('_', '-')}": value for name, value in asdict(self).items()}

    def settings(self) -> How:
        """Settings of the scan, in SI.

        Raises:
            InputError: A scan that is not moved is given a datum.
        """
        from counterflex.app.inspection.judging import How

        if self.aligned and (self.datum is not None or self.datum_points is not None):
            raise InputError(
                "a scan in the part frame is not moved, so that it takes no datum",
                where="--aligned",
                hint="Leave out --aligned, or --datum and --datum-points",
            )
        ball_m, clearance_m = (
            None if value is None else value * MM for value in (self.ball_diameter_mm, self.clearance_mm)
        )
        return How(self.unit, self.datum, self.datum_points, self.aligned, ball_m, clearance_m)

    def map_writer(self, program: Path, cell: Path) -> Callable[[Path, object], None] | None:
        """Return what writes the deviations that lie in a folder as a map; refuses a name that says no format."""
        if self.export is None:
            if self.export_frame is not None:
                raise InputError(
                    "no map is exported that could have a frame", where="--export-frame", hint="Give --export FILE too"
                )
            return None
        from counterflex.app.inputs import read_in_plane
        from counterflex.app.inspection.inspect import DEVIATIONS
        from counterflex.files.cell.cell import read_cell
        from counterflex.files.deviation_map import require_format, write_deviation_map
        from counterflex.files.part_deviations import read_part_deviations

        export, frame = self.export, self.export_frame or "part"
        require_format(export)
        placed = replace(read_in_plane(program, read_cell(cell))[0], R_part_plane=None)
        T_frame_part = placed.T_base_part if frame == "base" else None
        return lambda folder, _: write_deviation_map(
            export, read_part_deviations(folder / DEVIATIONS)[0], T_frame_part, frame
        )


@dataclass(frozen=True)
class LogOptions:
    """Options by which a log of the tool is read."""

    frame: Annotated[
        str | None,
        option(
            "--frame",
            "Of a tracker's log: as-measured (the part frame), a cell file with [tracker], X,Y,Z,A,B,C of the "
            "tracker in the part frame (mm, deg), or fit: laid on the program's path; by default [tracker] of --cell.",
            frame_of,
            "FRAME",
        ),
    ] = None
    form: Annotated[
        str,
        option(
            "--format",
            "Of a tracker's log: " + ", ".join(FORMATS) + ".",
            arguments.one_of(FORMATS, "format of a tracker's export"),
            "NAME",
        ),
    ] = "counterflex"
    position: Annotated[
        str | None,
        option(
            "--position",
            "Of a run log: measured (by the tracker), reported (by the controller), commanded; by default the "
            "first of them that it holds, never the commanded one.",
            arguments.one_of(_POSITIONS, "position"),
            "NAME",
        ),
    ] = None
    run: Annotated[
        int | None,
        option(
            "--run",
            "Of run logs: number of the run, where a folder holds several.",
            metavar="N",
            min=0,
            max=arguments.MOST_RECORDS,
        ),
    ] = None
    cut: Annotated[
        bool, option("--cut", "The part was cut while the tool was logged; without it all feed motion counts.")
    ] = False

    def given(self) -> dict[str, object]:
        """Values by the names of the options."""
        return {
            "--frame": self.frame,
            "--position": self.position,
            "--run": self.run,
            "--cut": self.cut,
            "--format": None if self.form == "counterflex" else self.form,
        }

    def settings(self) -> LogHow:
        """Settings of the log."""
        from counterflex.app.inspection.tool_log import LogHow

        return LogHow(self.frame, self.form, self.position, self.run, self.cut)


@dataclass(frozen=True)
class ReferenceOptions:
    """Options that name what the part is judged against."""

    before: Annotated[
        Path | None,
        option(
            "--before",
            "Scan, or log of the tool, of an earlier part to compare with.",
            arguments.file_or_folder,
            "FILE|DIR",
        ),
    ] = None
    nominal: Annotated[
        Path | None,
        option(
            "--nominal",
            "CAD solid (STEP, its faces become features) or mesh (STL, mm), part frame, to judge against in place of "
            "what the program makes.",
            arguments.file,
            "CAD",
        ),
    ] = None
    tolerances: Annotated[
        Path | None,
        option(
            "--tolerances",
            "Tolerances of the drawing: columns feature, quantity, tolerance_mm; without it ISO 2768-mK.",
            arguments.file,
            "CSV",
        ),
    ] = None

    def tolerances_m(self) -> dict[tuple[str, str], float] | None:
        """(feature, quantity) to +- tolerance, m; None: general tolerances."""
        from counterflex.files.small_table import read_tolerances

        return None if self.tolerances is None else read_tolerances(self.tolerances)


@with_records
def inspect(
    program: Program,
    cell: CellFile,
    out: Out,
    scan: Annotated[
        Path | None,
        option(
            "--scan",
            "Scan of the part: PLY, STL, OBJ, E57, LAS, PCD, PTX, table or report of points, DMIS output, QIF.",
            arguments.file,
            "FILE",
        ),
    ] = None,
    tool_log: Annotated[
        Path | None,
        option(
            "--tool-log",
            "In place of a scan: log of the tool along the program, by a tracker (log, export, dataset .toml) or "
            "run logs of counterflex (folder or .mcap).",
            arguments.file_or_folder,
            "FILE|DIR",
        ),
    ] = None,
    *,
    of_scan: ScanOptions,
    reference: ReferenceOptions,
    of_log: LogOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Judge a real part: its scan, or the measured path of the tool, against what the program makes.

    A scan may lie in any pose. It is laid on faces of the blank that the program leaves alone, never on what is to
    be judged. Of a log of the tool (--tool-log) its deviation from the program's path is judged, and the part that it
    would leave; the surface is not measured then. Writes into DIR: deviations.parquet (tool-path.parquet of a log),
    report.html (map, sections, features), summary.json.

    Example: `counterflex inspect part.ngc --cell cell.toml --scan part.ply --out inspected`
    """
    before, nominal = reference.before, reference.nominal
    inputs = (program, cell, scan, tool_log, of_scan.datum_points, before, nominal, reference.tolerances)
    keep_inputs(out, *inputs)
    keep_inputs(of_scan.export, *inputs, option="--export")
    measured = _measured(scan, tool_log, of_scan.given(), of_log.given())
    if scan is not None and before is not None and before.is_dir():
        raise InputError("it is a folder", where=f"--before {before}", limit="a scan, as --scan")
    from counterflex.app.inspection import inspect as job

    more = of_scan.map_writer(program, cell)
    how = of_scan.settings() if tool_log is None else of_log.settings()
    with progress_bar(f"inspecting {measured.name}") as progress:
        summary = job.run(
            program,
            cell,
            measured,
            out,
            how=how,
            before=before,
            nominal=nominal,
            tolerances_m=reference.tolerances_m(),
            more=more,
            progress=progress,
        )
    rows = "deviations.parquet" if tool_log is None else "tool-path.parquet"
    print_summary(summary, as_json, out, f": {rows}, report.html, summary.json")
    if as_json:
        return
    frame = of_scan.export_frame or "part"
    say_written(of_scan.export, f"wrote {of_scan.export}: deviation_mm, positive = material left, {frame} frame")
