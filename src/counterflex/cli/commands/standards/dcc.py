"""Commands dcc: values of digital calibration certificates in, results of identifications out."""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.output import keep_inputs, print_summary
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.result import Lines, PlainLine
from counterflex.core.similar import twice

dcc = typer.Typer(
    no_args_is_help=True, help="Digital calibration certificates (DCC): values into a cell file, results as a document."
)


def _keys(_: arguments.Param, value: Any) -> Any:
    """Keys, each with its quantity or without."""
    from counterflex.app.certificate.keys import pair_of

    if (key := twice([pair_of(text)[0] for text in value or ()])) is not None:
        raise InputError("a key is given twice", where="--set", value=key)
    return value


def _channel(_: arguments.Param, value: Any) -> Any:
    """A unit of D-SI."""
    from counterflex.files.certificate.dsi_unit import parse_unit

    try:
        parse_unit(value, "--channel")
    except CounterflexError as fault:
        raise InputError(fault.what, where=fault.where, value=fault.value, limit=fault.limit) from fault
    return value


def _country(_: arguments.Param, value: Any) -> Any:
    """Two capital letters."""
    if not re.fullmatch("[A-Z]{2}", value):
        raise InputError(
            "no country", where="--country", value=value[:40], limit="two capital letters of ISO 3166, as DE"
        )
    return value


def days(text: str | None) -> tuple[str, str] | None:
    """First and last day of ``2026-03-14,2026-03-15``; one day is both.

    Raises:
        InputError: Not one or two days, or the last before the first.
    """
    if text is None:
        return None
    parts = text.split(",")
    try:
        dates = [datetime.date.fromisoformat(part.strip()) for part in parts]
    except ValueError:
        dates = []
    if len(dates) not in (1, 2) or dates[-1] < dates[0]:
        raise InputError(
            "not the days of a measurement",
            where="--measured",
            value=text[:40],
            limit="2026-03-14 or 2026-03-14,2026-03-15",
        )
    return dates[0].isoformat(), dates[-1].isoformat()


def _days(_: arguments.Param, value: Any) -> Any:
    """One or two days."""
    days(value)
    return value


CertificateFile = Annotated[Path, argument("Certificate (.xml), DCC 3.x.", arguments.file, "CERTIFICATE")]


def show(certificate: CertificateFile, as_json: AsJson = False) -> None:
    """List what a calibration certificate states: laboratory, day, item, and each quantity with standard uncertainty.

    Coverage factors are divided out. What is not read is named. A signature is not checked.

    Example: `counterflex dcc show sensor.xml`
    """
    from counterflex.app.certificate.write import described

    print_summary(described(certificate), as_json)


def apply(
    certificate: CertificateFile,
    keys: Annotated[
        list[str],
        option(
            "--set",
            "Key to fill, and number, id or kind of its quantity where several fit; may be given several times.",
            _keys,
            "KEY[=QUANTITY]",
        ),
    ],
    out: Annotated[Path, option("--out", "File to write.", arguments.output_file, "FILE")],
    cell: Annotated[Path | None, option("--cell", "Cell file (.toml).", arguments.file, "CELL")] = None,
    dataset: Annotated[
        Path | None, option("--dataset", "Manifest of a dataset instead.", arguments.file, "MANIFEST")
    ] = None,
    channel: Annotated[
        str, option("--channel", "For sensor.frame.matrix: what the sensor sends, in D-SI.", _channel, "UNIT")
    ] = r"\one",
    as_json: AsJson = False,
) -> None:
    r"""Write a copy of a cell file, or of a manifest, with values of a calibration certificate.

    Keys of a cell file: sensor.range_n, sensor.range_nm, sensor.frame.counts_per_n, sensor.frame.counts_per_nm,
    sensor.frame.matrix, end_effector.NAME.mass_kg. Of a manifest: channels.distance, settings.force_accuracy_n.
    Units and number of values must fit. Certificate and uncertainty stand behind each value.

    Example: `counterflex dcc apply sensor.xml --set sensor.range_n --cell cell.toml --out calibrated.toml`
    """
    from counterflex.app.certificate.keys import pair_of

    if (cell is None) == (dataset is None):
        raise InputError("one file takes the values", limit="--cell CELL or --dataset MANIFEST")
    keep_inputs(out, certificate, cell, dataset)
    from counterflex.app.certificate.apply import apply_certificate

    answer = apply_certificate(
        certificate, [pair_of(text) for text in keys], out, cell=cell, dataset=dataset, channel=channel
    )
    lines = [
        PlainLine(f"{row['key']} from {row['quantity']}: {row['sigma'] or 'no uncertainty stated'}")
        for row in answer["written"]
    ]
    if answer["signed"]:
        lines.append(PlainLine("note: the signature of the certificate was not checked"))
    print_summary(Lines(answer, *lines), as_json, out, ": {certificate}")


def write(
    result: Annotated[Path, argument("result.json of an identification.", arguments.file, "RESULT")],
    laboratory: Annotated[str, option("--laboratory", "Who measured and identified.", metavar="NAME")],
    person: Annotated[str, option("--person", "Who answers for it.", metavar="NAME")],
    city: Annotated[str, option("--city", "Of the laboratory.", metavar="NAME")],
    country: Annotated[str, option("--country", "Of the laboratory, two letters.", _country, "CODE")],
    serial: Annotated[str, option("--serial", "Serial number of the robot.", metavar="TEXT")],
    out: Annotated[Path, option("--out", "Document to write (.xml).", arguments.output_file, "FILE")],
    measured: Annotated[
        str | None, option("--measured", "First and last day; by default that of identify.", _days, "DAY[,DAY]")
    ] = None,
    schema: Annotated[
        Path | None,
        option("--schema", "dcc.xsd of PTB, D-SI beside it: check the document (extra dcc).", arguments.file, "XSD"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the result of an identification as a document in the form of a DCC: values, units, 95 % intervals.

    It is no calibration certificate, and says so: no accredited laboratory stands behind it.

    Example: `counterflex dcc write result.json --laboratory A --person B --city Ulm --country DE --serial 7 --out a`
    """
    keep_inputs(out, result, schema)
    if schema is not None:
        from counterflex.files.certificate.document import require_library

        require_library()
    from counterflex.app.certificate.write import write_document

    answer = write_document(
        result, out, laboratory=laboratory, person=person, country=country, city=city, serial=serial,
        dates=days(measured), schema=schema,
    )  # fmt: skip
    checked = "valid by the schema" if answer["checked"] else "not checked against a schema"
    print_summary(Lines(answer), as_json, out, f": {{number}}, {{quantities}} quantities, {checked}")


dcc.command("show")(show)
dcc.command("apply")(apply)
dcc.command("write")(write)
