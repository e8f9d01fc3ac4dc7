"""Values of a calibration certificate into a cell file or the manifest of a dataset; everything else there is kept."""

from __future__ import annotations

import os
from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from counterflex.app.certificate.keys import MATRIX, Key, key_of
from counterflex.core import atomic
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.document import move_paths, parsed, table_of
from counterflex.files.certificate.document import Certificate, read_certificate
from counterflex.files.certificate.dsi_unit import Unit, parse_unit
from counterflex.files.certificate.quantities import Quantity
from counterflex.files.dataset.manifest import read_manifest

_FORCE: Final = (1, 1, -2, 0, 0, 0)
_MOMENT: Final = (2, 1, -2, 0, 0, 0)
_ROWS: Final = (_FORCE,) * 3 + (_MOMENT,) * 3
_EXPANDED: Final = 2.0  # Coverage factor of an expanded uncertainty that counterflex writes


@dataclass(frozen=True)
class CertificateValue:
    """A quantity, or several together, in SI."""

    name: str
    values: tuple[float, ...]  # SI
    sigma: tuple[float, ...] | None  # Standard uncertainties, SI; None where none is stated
    units: tuple[Unit, ...]  # Of each value

    def channel_units(self) -> set[tuple[int, ...]]:
        """Exponents of a channel's unit, of each element of a matrix."""
        rows = [exponents for exponents in _ROWS for _ in range(6)]
        return {
            tuple(r - n for r, n in zip(row, unit.exponents, strict=True))
            for row, unit in zip(rows, self.units, strict=False)
        }

    def share(self) -> str:
        """Standard uncertainty as a share of the largest value; empty where none is stated."""
        most = max(abs(v) for v in self.values)
        if self.sigma is None or most == 0.0:
            return ""
        return f"standard uncertainty {max(self.sigma) / most:.2g} of the value"


def apply_certificate(
    file: Path,
    keys: Sequence[tuple[str, str]],
    out: Path,
    *,
    cell: Path | None = None,
    dataset: Path | None = None,
    channel: str = r"\one",
) -> dict[str, Any]:
    """Write a copy of a cell file or manifest with values of a certificate.

    Args:
        keys: Key, and number, id or kind of the quantity for it; empty where only one fits.
        cell: Cell file; this or ``dataset``.
        channel: D-SI unit in which the sensor sends its channels, for a calibration matrix.

    Returns:
        What went where.

    Raises:
        FileFormatError: A file cannot be read, or a quantity is not understood.
        InputError: A key that is not of this file, no quantity or several that fit.
    """
    template, kind = (cell, "cell") if cell is not None else (dataset, "dataset")
    if template is None:
        raise InputError("no file to put the values into", limit="--cell CELL or --dataset MANIFEST")
    certificate, doc = read_certificate(file), parsed(template)
    written = []
    for name, quantity in keys:
        key, body = key_of(name)
        if key.file != kind:
            raise InputError(
                f"this key belongs into a {'manifest' if key.file == 'dataset' else 'cell file'}", where="--set",
                value=name, hint=f"Give --{key.file}",
            )  # fmt: skip
        value = _value(certificate, key, quantity)
        matrix_unit = parse_unit(channel, "--channel") if key.name == MATRIX else None
        text = _enter(doc, key, body, value, certificate.source, matrix_unit)
        written.append({"key": name, "quantity": value.name, "value": text, "sigma": value.share()})
    _write(doc, template, out, cell is not None)
    return {"file": str(out), "certificate": certificate.source, "written": written, "signed": certificate.signed}


def _value(certificate: Certificate, key: Key, requested: str) -> CertificateValue:
    """The quantity for a key: the one that is named, or the only one that fits."""
    where = certificate.file
    if requested:
        chosen = [_named(certificate, one.strip()) for one in requested.split(",")]
        value = _together(chosen, where)
        fault = _misfit(key, value)
        if fault:
            raise FileFormatError(fault, where=f"{where}: {value.name}", limit=key.text)
        return value
    fits = []
    for quantity in certificate.quantities:
        try:
            value = _together([quantity], where)
        except FileFormatError:
            continue
        if not _misfit(key, value):
            fits.append((quantity.number, value))
    if len(fits) != 1:
        numbers = ", ".join(str(number) for number, _ in fits)
        raise InputError(
            f"several quantities fit {key.name}" if fits else f"no quantity fits {key.name}", where=where,
            value=numbers or f"{len(certificate.quantities)} quantities", limit=key.text,
            hint=f"Name one: --set {key.name}={fits[0][0]}" if fits else "counterflex dcc show lists what is there",
        )  # fmt: skip
    return fits[0][1]


def _named(certificate: Certificate, name: str) -> Quantity:
    """A quantity by its number, its XML id, or its kind where only one has it."""
    for matches in (
        [q for q in certificate.quantities if str(q.number) == name],
        [q for q in certificate.quantities if q.ident == name],
        [q for q in certificate.quantities if name in q.ref_types],
    ):
        if len(matches) == 1:
            return matches[0]
        if matches:
            break
    raise InputError(
        "several quantities are of this kind" if matches else "no quantity of this number, id or kind",
        where=certificate.file, value=name, limit=f"1 to {len(certificate.quantities)}",
        hint="counterflex dcc show lists what is there",
    )  # fmt: skip


def _together(chosen: Sequence[Quantity], where: str) -> CertificateValue:
    """Quantities one behind the other, in SI."""
    values: list[float] = []
    sigma: list[float] = []
    units: list[Unit] = []
    for one in chosen:
        place = f"{where}: quantity {one.number}"
        if one.unread:
            raise FileFormatError(f"not understood: {one.unread}", where=place, value=one.name or None)
        of_values = [parse_unit(text, place) for text in one.units]
        values += [v * unit.factor for v, unit in zip(one.values, of_values, strict=True)]
        sigma += [s * unit.factor for s, unit in zip(one.sigma or (), of_values, strict=bool(one.sigma))]
        units += of_values
    name = ", ".join(f"quantity {one.number}{f' ({one.name})' if one.name else ''}" for one in chosen)
    return CertificateValue(name, tuple(values), tuple(sigma) if len(sigma) == len(values) else None, tuple(units))


def _misfit(key: Key, value: CertificateValue) -> str:
    """Return why a value cannot go to a key; empty where it can."""
    if key.counts and len(value.values) not in key.counts:
        return f"{len(value.values)} numbers where {key.counts[0]} belong"
    if key.exponents is not None:
        wrong = next((unit for unit in value.units if unit.exponents != key.exponents), None)
        if wrong is not None:
            return f"the unit is {wrong.si}"
    elif len(value.channel_units()) != 1:
        return "the rows are not N, N, N, N m, N m, N m per one unit of a channel"
    if key.uncertain and value.sigma is None:
        return "no uncertainty is stated"
    if key.exponents is not None and min(value.values) <= 0.0:
        return "a value that is not above zero"
    return ""


def _enter_matrix(doc: MutableMapping[str, Any], key: Key, value: CertificateValue, note: str, channel: Unit) -> Any:
    (of_channel,) = value.channel_units()
    if of_channel != channel.exponents:
        raise InputError(
            "the matrix is per another unit of a channel", where="--channel", value=channel.si,
            limit=Unit(1.0, of_channel).si, hint="Say in D-SI what the sensor sends",
        )  # fmt: skip
    rows = np.array(value.values).reshape(6, 6) * channel.factor
    frame = _table(doc, ("sensor", "frame"), key)
    frame["matrix"] = _array_of_rows(rows)
    frame["matrix"].comment(note)
    return [[_digits(v) for v in row] for row in rows]


def _enter(
    doc: MutableMapping[str, Any], key: Key, body: str, value: CertificateValue, source: str, channel: Unit | None
) -> Any:
    """Enter a value; what was entered."""
    note = f"{source}; {value.share() or 'no uncertainty stated'}"
    if channel is not None:
        return _enter_matrix(doc, key, value, note, channel)
    if body:
        bodies = {str(one.get("name")): one for one in reversed(doc.get("end_effector", ()))}
        if body not in bodies:
            known = ", ".join(reversed(bodies)) or "none"
            raise InputError("no such body in the cell", where="--set", value=body, limit=known)
        return _put(bodies[body], "mass_kg", _digits(value.values[0]), note)
    *tables, last = key.name.split(".")
    if key.name == "channels.distance":
        table = _table(doc, ("channels",), key)
        if "columns" in table.get("distance", {}):
            raise InputError(
                "the manifest reads this channel from columns", where="channels.distance", limit="constant"
            )
        assert value.sigma is not None
        made = table_of(table, "distance")
        made["constant"], made["unit"] = [_digits(value.values[0] / MM)], "mm"
        _put(made, "sigma", _digits(value.sigma[0] / MM), note)
        return f"{_digits(value.values[0] / MM)} mm"
    if key.name == "settings.force_accuracy_n":
        assert value.sigma is not None
        return _put(table_of(doc, "settings"), last, _digits(_EXPANDED * max(value.sigma)), note)
    return _put(_table(doc, tables, key), last, _digits(value.values[0]), note)


def _table(doc: MutableMapping[str, Any], path: Sequence[str], key: Key) -> Any:
    table: Any = doc
    for name in path:
        if name not in table:
            raise InputError(
                f"there is no table [{'.'.join(path)}]", where="--set", value=key.name,
                hint="Add it first: docs/cell-file.md" if key.file == "cell" else "Add it first: docs/datasets.md",
            )  # fmt: skip
        table = table[name]
    return table


def _put(table: Any, name: str, value: float, note: str) -> float:
    table[name] = value
    table[name].comment(note)
    return value


def _array_of_rows(rows: Any) -> Any:
    array = tomlkit.array()
    for row in rows:
        array.add_line([_digits(v) for v in row])
    array.add_line(indent="")
    return array


def _digits(value: float) -> float:
    return float(f"{float(value):.9g}")


def _write(doc: Any, template: Path, out: Path, is_cell: bool) -> None:
    """Write the document and read it back before it takes its place."""
    check: Callable[[Path], object] = read_cell if is_cell else read_manifest
    if is_cell:
        move_paths(doc, template.parent, out.parent)
    else:
        for one in doc.get("files", ()):
            if not Path(str(one["path"])).is_absolute():
                one["path"] = Path(os.path.relpath(template.parent / str(one["path"]), out.parent)).as_posix()
    with atomic.atomic_path(out) as place:
        place.write_text(tomlkit.dumps(doc), encoding="utf-8", newline="\n")
        check(place)
