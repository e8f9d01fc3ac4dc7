"""A proposal of measurements: ``proposal.csv`` (one row for each, in order), ``proposal.toml``, a manifest to fill."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from counterflex.core import atomic
from counterflex.core.errors import FileFormatError
from counterflex.core.next_command import next_command
from counterflex.files.dataset.manifest import KIND as DATASET, VERSION as DATASET_VERSION, FileTable
from counterflex.files.dataset.table import read_table
from counterflex.files.dataset.units import settings_shop, settings_si, toml_line
from counterflex.files.dataset.writer import DIGITS, column_names
from counterflex.files.schema import Versioned, write_toml
from counterflex.identify.data.channels import CHANNELS, CHANNELS_OF, SAMPLED, SETTINGS
from counterflex.identify.recipe import Proposal

KIND: Final = "counterflex-proposal"
VERSION: Final = 1
PROPOSAL: Final = "proposal.toml"
ROWS: Final = "proposal.csv"


def form_names(recipe: str) -> tuple[str, str]:
    """Manifest and table of what a recipe measures: of the form to fill, and of a simulated laboratory."""
    return f"{recipe}.toml", f"{recipe}.csv"


class ProposalTable(Versioned):
    """A whole proposal file."""

    recipe: str
    kind: str
    rows: str
    remarks: tuple[str, ...] = ()
    expected: dict[str, float] = Field(default={})
    units: dict[str, str] = Field(default={})
    settings: dict[str, Any] = Field(default={})


def write_proposal(folder: Path, proposal: Proposal) -> Path:
    """Write a proposal and, for datasets of its kind, a manifest with a table to fill.

    Returns:
        Path of ``proposal.toml``.
    """
    columns = [settings_shop(name, np.asarray(values)) for name, values in proposal.columns.items()]
    names = [name for name, _ in columns]
    cells = [[f"{v:.{DIGITS}g}" for v in values] for _, values in columns]
    _write_csv(folder / ROWS, names, cells)
    data = {
        "format": KIND,
        "version": VERSION,
        "recipe": proposal.recipe,
        "kind": proposal.kind,
        "rows": ROWS,
        "remarks": list(proposal.remarks),
        "expected": {name: float(f"{sigma:.6g}") for name, sigma in proposal.expected.items()},
        "units": dict(proposal.units),
        "settings": dict(settings_shop(key, value) for key, value in proposal.settings.items()),
    }
    write_toml(folder / PROPOSAL, data, comment="Expected standard deviations are in SI units.")
    for name, text in proposal.files.items():
        atomic.write_text(folder / name, text)
    _write_form(folder, proposal, dict(zip(names, cells, strict=True)))
    return folder / PROPOSAL


def read_proposal(path: str | Path) -> Proposal:
    """Read a proposal back, in SI.

    Args:
        path: ``proposal.toml``.

    Raises:
        FileFormatError: Missing, damaged, another format, or newer than this program.
    """
    file = Path(path)
    table = ProposalTable.read(file, kind=KIND, version=VERSION)
    rows = read_table(file.parent / table.rows, FileTable(path=table.rows))
    columns = {}
    for i, name in enumerate(rows.header):
        numbers, missing = rows.numbers(i)
        if np.any(missing):
            raise FileFormatError("the cell is empty", where=rows.place_of(i, int(np.argmax(missing))))
        key, values = settings_si(name, numbers.tolist())
        columns[key] = np.array(values)
    return Proposal(
        recipe=table.recipe,
        kind=table.kind,
        columns=columns,
        expected=table.expected,
        remarks=table.remarks,
        settings=dict(settings_si(key, value) for key, value in table.settings.items()),
        units=table.units,
    )


def _channel_lines(channel: str, own: list[str], *, measured: bool) -> list[str]:
    """Table of a channel in the manifest, with a place for its standard deviation where it is to be measured."""
    kind = CHANNELS[channel]
    units = list(dict.fromkeys(kind.file_units(len(own))))
    lines = ["", f"# {kind.text}", f"[channels.{channel}]", f"columns = {toml_line(own)}"]
    if set(units) != {"1"}:
        lines.append(f"unit = {toml_line(units[0] if len(units) == 1 else units)}")
    if kind.nature == "rotation":
        lines.append('rotation = "rotation_vector"')
    if measured and not kind.whole and channel not in ("time_s", "temperature_c"):
        lines.append("# sigma = " + ("..." if len(units) == 1 else "[..., ...]"))
    return lines


def _write_form(folder: Path, proposal: Proposal, proposed: Mapping[str, list[str]]) -> None:
    """A table with the proposed columns filled in and those to be measured empty, and its manifest."""
    channels = CHANNELS_OF.get(proposal.kind)
    if channels is None:
        return
    manifest, measured = form_names(proposal.recipe)
    count = 0 if proposal.kind in SAMPLED else len(next(iter(proposed.values())))
    names: list[str] = []
    cells: list[list[str]] = []
    lines = [
        f"# Fill {measured}, or name another file with its columns; state the standard deviations (sigma), then:",
        f"# {next_command(f'identify {proposal.recipe}', manifest, cell='CELL', out='DIR')}",
        f'format = "{DATASET}"',
        f"version = {DATASET_VERSION}",
        f'name = "{proposal.recipe}"',
        f'kind = "{proposal.kind}"',
        "",
        "[[files]]",
        f'path = "{measured}"',
        '# separator = ";"',
        '# decimal = ","',
    ]
    for channel in channels:
        own = column_names(channel, CHANNELS[channel], CHANNELS[channel].allowed[-1])
        names += own
        planned = [planned_for(name, channel, proposed) for name in own]
        cells += [proposed[one][:count] if one else [""] * count for one in planned]
        lines += _channel_lines(channel, own, measured=not all(name in proposed for name in own))
    known = {key: value for key, value in proposal.settings.items() if settings_si(key, 0.0)[0] in SETTINGS}
    if known:
        lines += ["", "[settings]"]
        lines += [f"{key} = {toml_line(value)}" for key, value in (settings_shop(k, v) for k, v in known.items())]
    _write_csv(folder / measured, names, cells)
    atomic.write_text(folder / manifest, "\n".join(lines) + "\n")


def planned_for(name: str, channel: str, proposed: Iterable[str]) -> str:
    """Column of a proposal that a column of its form begins with: ``fx_n`` for ``f_tcp_base_fx_n``; empty: none."""
    return next((one for one in proposed if one == name or name == f"{channel}_{one}"), "")


def _write_csv(path: Path, names: list[str], columns: list[list[str]]) -> None:
    rows = [",".join(names), *(",".join(row) for row in zip(*columns, strict=True))]
    atomic.write_text(path, "\n".join(rows) + "\n")
