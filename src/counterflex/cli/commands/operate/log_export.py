"""The command log export: records as CSV, or a run for another viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import MOST_RECORDS, option
from counterflex.cli.commands.operate.run_history import INCOMPLETE, Folder, Number
from counterflex.cli.output import keep_inputs, progress_bar, say_written
from counterflex.core.errors import InputError
from counterflex.core.units import UM

VIEWERS = ("foxglove", "rerun")


def export(
    folder: Folder,
    csv: Annotated[Path | None, option("--csv", "File to write.", arguments.output_file, "FILE")] = None,
    incident: Annotated[
        int | None,
        option(
            "--incident", "Only the cycles around this hold or fault, as `log show` counts.", min=1, max=MOST_RECORDS
        ),
    ] = None,
    before: Annotated[int, option("--before", "Cycles before the incident.", min=0, max=MOST_RECORDS)] = 250,
    after: Annotated[int, option("--after", "Cycles after its first one.", min=0, max=MOST_RECORDS)] = 250,
    viewer: Annotated[
        str | None,
        option(
            "--to", "foxglove (.mcap) or rerun (.rrd; needs the extra `rerun`).", arguments.one_of(VIEWERS, "viewer")
        ),
    ] = None,
    out: Annotated[Path | None, option("--out", "File to write for the viewer.", arguments.output_file, "FILE")] = None,
    number: Number = None,
    range_um: Annotated[
        float, option("--range-um", "Deviation at which the colours of the cut end.", min=1.0, max=10000.0)
    ] = 200.0,
) -> None:
    """Write records as CSV (--csv), in SI units and part axes, bit for bit; or a run for another viewer (--to, --out).

    With --incident only the cycles around one hold or fault, with units in the headings, and state and cause in words.
    Ends with status 5 when cycles are missing in what was written.

    For a viewer: frames, bodies of the cell, the cut in the colours of the deviation that remained, curves of
    deviation, force and loop, states and what operators did. The bodies need the cell file of the run where it was.

    Example: `counterflex log export log --csv run.csv`

    Example: `counterflex log export log --to foxglove --out run.mcap`
    """
    if (csv is None) == (viewer is None) or (viewer is None) != (out is None):
        raise InputError(
            "what is to be written is not clear",
            value=", ".join(name for name, one in (("--csv", csv), ("--to", viewer), ("--out", out)) if one is not None)
            or "nothing given",
            limit="--csv FILE, or --to VIEWER --out FILE",
        )
    if viewer is not None and out is not None:
        _to_viewer(folder, viewer, out, number, range_um)
    elif csv is not None:
        _to_csv(folder, csv, incident, before, after)


def _to_viewer(folder: Path, viewer: str, out: Path, number: int | None, range_um: float) -> None:
    keep_inputs(out, *sorted(folder.glob("run-*.mcap*")), option="--out")
    from counterflex.app.log_export.job import export_to

    with progress_bar("exporting") as progress:
        done = export_to(folder, viewer, out, number=number, range_m=range_um * UM, progress=progress)
    cell = "" if done["cell"] else "; without the cell, whose file is not where it was"
    say_written(out, f"wrote {out}: {done['messages']} messages of {done['cycles']} cycles{cell}")


def _to_csv(folder: Path, csv: Path, incident: int | None, before: int, after: int) -> None:
    keep_inputs(csv, *sorted(folder.glob("run-*.mcap*")), option="--csv")
    if incident is None:
        from counterflex.app.run import log as job

        with progress_bar("exporting") as progress:
            count, missing = job.export(folder, csv, progress)
        for line in (*missing.lines(), f"wrote {csv}: {count} records"):
            say_written(csv, line)
        _end(incomplete=missing.incomplete)
        return
    from counterflex.app.run.incidents import export_incident

    with progress_bar("exporting") as progress:
        done = export_incident(folder, incident, csv, before=before, after=after, progress=progress)
    shown = done.of.shown()
    lost = f", {done.missing} cycles in between have no record" if done.missing else ""
    say_written(
        csv,
        f"wrote {csv}: {done.cycles} cycles around the {shown['state']} of cycle {shown['cycle']}"
        f" ({shown['cause'].replace('_', ' ')}){lost}",
    )
    _end(incomplete=done.missing > 0)


def _end(*, incomplete: bool) -> None:
    if incomplete:
        raise typer.Exit(INCOMPLETE)
