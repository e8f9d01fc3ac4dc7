"""Put identified values into a cell file: only what changed, with comments, order and everything else kept."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from counterflex.core import atomic, held
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError, ModelError
from counterflex.core.units import DEG, MM, MRAD, MS, N_PER_MM, N_PER_MM2, UM, UM_PER_KN, URAD, URAD_PER_KNM
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.document import Doc, move_paths, new_table, parsed, row_of, table_of
from counterflex.files.cell.measured import IdentifiedTable
from counterflex.files.schema import STIFFEST
from counterflex.identify.data.changes import (
    AxisPlay,
    AxisServo,
    BodyMass,
    Calibration,
    Change,
    CuttingLaw,
    ElementCompliance,
    ElementRegion,
    TableValues,
)
from counterflex.robot.model.description import ComplianceCurve
from counterflex.robot.model.elastic_region import DIRECTIONS

DIGITS: Final = 9
"""Significant digits of written values."""
COMPLIANCE_KEYS: Final = (
    *((f"t{a}_um_per_kn", UM_PER_KN) for a in "xyz"),
    *((f"r{a}_urad_per_knm", URAD_PER_KNM) for a in "xyz"),
)
_CALIBRATION_KEYS: Final = (*((f"{a}_mm", MM) for a in "xyz"), *((f"r{a}_mrad", MRAD) for a in "xyz"))
_SAME_PLACE_M: Final = 1e-9


def updated_text(cell: Cell, changes: Sequence[Change], entry: IdentifiedTable, folder: Path) -> str:
    """Text of the cell's file with changes applied.

    Args:
        entry: Provenance; it replaces an earlier entry of the same recipe.
        folder: Where the new file will lie; paths in it that are relative are made relative to there.

    Raises:
        FileFormatError: The file has changed since it was read.
        InputError: A change names a segment that the cell does not have.
    """
    doc = parsed(cell.path)
    source = f"identified: {entry.recipe}, {entry.date}"
    for change in changes:
        apply(doc, change, cell, source)
    _enter(doc, entry)
    move_paths(doc, cell.path.parent, folder)
    return tomlkit.dumps(doc)


def check_update(text: str, path: Path) -> Cell:
    """Read an updated text back as a cell, from a file that is written for it.

    Args:
        path: Where it is written; relative paths in it are relative to its folder.

    Raises:
        FileFormatError: What was identified is out of the ranges of a cell file.
    """
    path.write_text(text, encoding="utf-8", newline="\n")
    return read_cell(path)


def require_new(target: Path, template: Path) -> None:
    """Refuse to write over a file. Raises InputError: the target is the template, or any file that is there."""
    if target.resolve() == template.resolve():
        raise InputError("the cell file itself is not overwritten", where="--apply", value=target)
    if target.exists():
        raise InputError("this file is already there", where="--apply", value=target, hint="Name a new cell file")


@contextlib.contextmanager
def new_file(target: Path | None) -> Iterator[Path | None]:
    """As :func:`new_cell`; None without a target.

    Opened around :func:`~counterflex.core.atomic.atomic_folder`, so that the file appears when the folder is complete,
    and neither of them when it is not.
    """
    if target is None:
        yield None
        return
    with new_cell(target) as place:
        yield place


@contextlib.contextmanager
def new_cell(target: Path) -> Iterator[Path]:
    """A place for a new cell file beside its target, put there when the block ends well.

    Raises:
        InputError: Another process has written the target meanwhile; it is left as it is.
    """
    with contextlib.ExitStack() as lock, atomic.atomic_path(target) as place:
        yield place
        lock.enter_context(held.alone(target))  # until the file has its name
        if target.exists():
            raise InputError(
                "another process has written this file meanwhile", where=str(target), hint="Name another new cell file"
            )


def write_new(text: str, target: Path, place: Path, what: str) -> None:
    """Write a cell file that was read back from a trial beside it.

    Raises:
        ModelError: It is no possible cell; nothing is written.
    """
    trial = target.parent / f".{target.name}.trial.toml"
    try:
        check_update(text, trial)
    except CounterflexError as fault:
        raise ModelError(
            f"{what} makes no possible cell",
            where=target.name,
            value=str(fault).replace(str(trial), target.name),
            hint="Nothing was written",
        ) from fault
    finally:
        trial.unlink(missing_ok=True)
    place.write_text(text, encoding="utf-8", newline="\n")


def apply(doc: Doc, change: Change, cell: Cell, source: str) -> None:
    """Apply one change to the tables of a cell file.

    Args:
        source: Goes into the ``source`` key of what is written.

    Raises:
        InputError: An unknown segment, or a value that the cell file has no place for.
    """
    match change:
        case ElementCompliance():
            _compliance(doc, change, cell, source)
        case Calibration():
            values = {
                key: _written(v, unit) for (key, unit), v in zip(_CALIBRATION_KEYS, change.displacement, strict=True)
            }
            _fill(row_of(table_of(doc, "robot"), "calibration", "segment", change.segment), values, source)
        case AxisPlay():
            play = change.play
            row = row_of(table_of(doc, "robot"), "play", "axis", change.axis + 1)
            friction = [_written(f, 1.0) for f in play.friction_nm]
            slip = [_written(s, URAD) for s in play.slip_rad]
            values = {"dead_band_half_urad": _written(play.half_band_rad, URAD)}
            _fill(row, {**values, "friction_nm": friction, "slip_urad": slip}, source)
        case AxisServo():
            servo = change.servo
            row = row_of(table_of(doc, "robot"), "servo", "axis", change.axis + 1)
            values = {
                "speed_gain_nm_s": _written(servo.speed_gain_nm_s, 1.0),
                "position_gain_per_s": _written(servo.position_gain_per_s, 1.0),
                "integral_time_ms": _written(servo.integral_time_s, MS),
                "friction_nm": _written(servo.friction_nm, 1.0),
                "slip_urad": _written(servo.slip_rad, URAD),
            }
            _fill(row, values, source)
        case ElementRegion():
            _region(doc, change, source)
        case BodyMass():
            _mass(doc, change, cell, source)
        case CuttingLaw():
            _law(doc, change, source)
        case TableValues():
            table = doc
            for key in change.table.split("."):
                table = table_of(table, key)
            for key, value in change.values.items():
                table[key] = value


def _compliance(doc: Doc, change: ElementCompliance, cell: Cell, source: str) -> None:
    segments = {segment.name: segment for segment in cell.robot.segments}
    if change.segment in segments:
        row = row_of(table_of(doc, "robot"), "elastic", "segment", change.segment)
        before: Float = segments[change.segment].compliance
    else:
        row = _body(doc, change.segment, cell)
        before = next(s.compliance for s in cell.end_effector.segments if s.name == change.segment)
    for (key, unit), value, old in zip(COMPLIANCE_KEYS, change.compliance, before, strict=True):
        # What is stiffer than a file can hold is rigid: over 1e12 N/m or N m/rad nothing bends that can be measured.
        value = 0.0 if 0.0 < value < STIFFEST * unit else value
        # Rigid is written only where something else would be read without it.
        if value != 0.0 or old != 0.0 or key in row:
            row[key] = _written(value, unit)
        if value == 0.0 and old != 0.0:
            for name in ("elastic_region", "compliance_curve"):
                _drop_rows(doc, name, change.segment, key.partition("_")[0])
    row["source"] = source


def _drop_rows(doc: Doc, name: str, segment: str, direction: str) -> None:
    """Remove the regions or curves of a spring."""
    rows = table_of(doc, "robot").get(name, ())
    for i in range(len(rows) - 1, -1, -1):
        if (rows[i]["segment"], rows[i]["direction"]) == (segment, direction):
            del rows[i]


def _region(doc: Doc, change: ElementRegion, source: str) -> None:
    """Add a row; an earlier region of the same spring and axis stays, factors multiply; an earlier curve goes."""
    region, robot = change.region, table_of(doc, "robot")
    direction = DIRECTIONS[region.direction]
    values: dict[str, Any] = {"segment": region.segment, "direction": direction}
    if isinstance(region, ComplianceCurve):
        name = "compliance_curve"
        _drop_rows(doc, name, region.segment, direction)
        loads = "loads_n" if direction.startswith("t") else "loads_nm"
        values[loads] = [_written(load, 1.0) for load in region.loads]
    else:
        name = "elastic_region"
        values |= {"axis": region.axis + 1, "angles_deg": [_written(angle, DEG) for angle in region.angles_rad]}
    values["factors"] = [_written(factor, 1.0) for factor in region.factors]
    if name not in robot:
        robot[name] = tomlkit.aot()
    rows = robot[name]
    row: Any = tomlkit.inline_table() if isinstance(rows, tomlkit.items.Array) else new_table()
    _fill(row, values, source)
    rows.append(row)


def _mass(doc: Doc, change: BodyMass, cell: Cell, source: str) -> None:
    for segment in cell.robot.segments:
        if segment.name == change.segment:
            if np.max(np.abs(change.p_seg_com - segment.p_seg_com)) > _SAME_PLACE_M:
                raise InputError(
                    "the centre of gravity of a robot segment has no place in a cell file", value=change.segment
                )
            row = row_of(table_of(doc, "robot"), "elastic", "segment", change.segment)
            row["mass_kg"] = _written(change.mass_kg, 1.0)
            row["source"] = source
            return
    row = _body(doc, change.segment, cell)
    row["mass_kg"] = _written(change.mass_kg, 1.0)
    for axis, value in zip("xyz", change.p_seg_com, strict=True):
        row[f"com_{axis}_mm"] = _written(value, MM)
    row["source"] = source


def _law(doc: Doc, change: CuttingLaw, source: str) -> None:
    law, old = change.law, table_of(doc, "material")
    entries = {"name": old.get("name") or old.get("catalog", ""), "allow_extrapolation": old.get("allow_extrapolation")}
    for key in list(old):
        del old[key]
    chip = {"chip_min_um": _written(law.h_min_m, UM), "chip_max_um": _written(law.h_max_m, UM)}
    if isinstance(law, KienzleLaw):
        k11 = law.k11_pa()
        values: dict[str, Any] = {
            "law": "kienzle",
            "kc11_n_mm2": _written(k11[0], N_PER_MM2),
            "mc": _written(law.mc, 1.0),
            "kr_over_kc": _written(k11[1] / k11[0], 1.0),
            "mr": _written(law.mr, 1.0),
            "ka_over_kc": _written(k11[2] / k11[0], 1.0),
            "ma": _written(law.ma, 1.0),
        }
        for key, edge in zip("cra", law.edge_n_m, strict=True):
            values[f"edge_{key}_n_mm"] = _written(edge, N_PER_MM)
    elif isinstance(law, LinearEdgeLaw):
        pressures = (("ktc", law.ktc_pa), ("krc", law.krc_pa), ("kac", law.kac_pa))
        edges = (("kte", law.kte_n_m), ("kre", law.kre_n_m), ("kae", law.kae_n_m))
        values = {
            "law": "linear_edge",
            **{f"{key}_n_mm2": _written(value, N_PER_MM2) for key, value in pressures},
            **{f"{key}_n_mm": _written(value, N_PER_MM) for key, value in edges},
        }
    else:
        raise InputError("this force law has no place in a cell file", value=type(law).__name__)
    for key, value in {**entries, **values, **chip, "source": source}.items():
        if value is not None and value != "":
            old[key] = value


def _written(value: float, unit: float) -> float:
    return float(f"{float(value) / unit:.{DIGITS}g}")


def _fill(row: Doc, values: Mapping[str, Any], source: str) -> None:
    for key, value in values.items():
        row[key] = value
    row["source"] = source


def _body(doc: Doc, name: str, cell: Cell) -> Doc:
    for row in doc.get("end_effector", ()):
        if row["name"] == name:
            result: Doc = row
            return result
    known = [s.name for s in (*cell.robot.segments, *cell.end_effector.segments)]
    raise InputError("the cell has no such segment", value=name, limit=", ".join(known))


def _enter(doc: Doc, entry: IdentifiedTable) -> None:
    """Add the entry to ``[[identified]]``, in the place of an earlier one of the same recipe."""
    if "identified" not in doc:
        doc["identified"] = tomlkit.aot()
    rows = doc["identified"]
    table = new_table()
    for key, value in entry.model_dump(mode="json").items():
        if key != "values":
            table[key] = value
    values = tomlkit.array()
    for item in entry.values:
        line = tomlkit.inline_table()
        for key, part in item.model_dump(mode="json").items():
            line[key] = part
        values.add_line(line)
    values.add_line(indent="")
    table["values"] = values
    for i, row in enumerate(rows):
        if row["recipe"] == entry.recipe:
            rows[i] = table
            return
    rows.append(table)
