"""Write a dataset: a CSV file in shop units and the manifest that maps it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import atomic
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.files.dataset.manifest import KIND, VERSION
from counterflex.files.dataset.units import UNITS, settings_shop, settings_si
from counterflex.files.schema import write_toml
from counterflex.geometry import rotation
from counterflex.identify.data.channels import KINDS, SETTINGS, ChannelKind, channel_kind
from counterflex.identify.recipes import added_kinds

DIGITS: Final = 12
"""Significant digits of written numbers."""
_SUFFIX: Final = {"N m": "nm", "1": "", "degC": "c", "m/s": "m_s", "mm/s": "mm_s", "V/V": "", "rad/s": "rad_s"}


def write_dataset(
    folder: str | Path,
    name: str,
    kind: str,
    channels: Mapping[str, Float],
    sigma: Mapping[str, float | Float],
    *,
    group: Int | None = None,
    settings: Mapping[str, Any] | None = None,
    sensors: Sequence[Mapping[str, Any]] = (),
) -> Path:
    """Write ``NAME.csv`` and ``NAME.toml``; :func:`counterflex.files.dataset.reader.read_dataset` reads them back.

    Args:
        channels: (n,) or (n, k) SI by canonical name; rotations as (n, 3) rotation vectors or (n, 3, 3) matrices.
        sigma: Standard deviations by channel name, SI: one, (k,), or (n, k); channels without one state none.
        group: (n,) ids of rows that belong together, written as a column ``group``.
        settings: Further facts by SI name.
        sensors: Of a measuring frame: ``name``, ``position_m``, ``direction``, ``normal``, ``point_m`` of each.

    Raises:
        InputError: Unknown kind, channel or setting; shapes that do not fit; numbers that are not finite.
        OutputError: The folder cannot be written.
    """
    if kind not in KINDS and kind not in added_kinds():
        raise InputError("there is no such kind of dataset", value=kind, limit=", ".join(KINDS))
    columns: dict[str, list[str]] = {} if group is None else {"group": [str(int(i)) for i in group]}
    tables = {key: _channel(key, values, sigma.get(key), columns) for key, values in channels.items()}
    if unknown := set(sigma) - set(channels):
        raise InputError("a standard deviation is given for a channel that is not", value=min(unknown))
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1 or 0 in lengths:
        raise InputError("channels have different lengths or no rows", where=name, value=sorted(lengths))
    path = Path(folder) / f"{name}.toml"
    rows = [",".join(columns), *(",".join(row) for row in zip(*columns.values(), strict=True))]
    manifest: dict[str, Any] = {"format": KIND, "version": VERSION, "name": name, "kind": kind}
    manifest |= {} if group is None else {"group": ["group"]}
    if settings:
        _require_known(settings)
        manifest["settings"] = _in_shop_units(settings)
    manifest["files"] = [{"path": f"{name}.csv"}]
    manifest["channels"] = tables
    if sensors:
        manifest["sensors"] = [_in_shop_units(one) for one in sensors]
    with atomic.atomic_folder(folder) as staging:
        atomic.write_text(staging / f"{name}.csv", "\n".join(rows) + "\n")
        write_toml(staging / path.name, manifest)
    return path


def _require_known(settings: Mapping[str, Any]) -> None:
    for key in settings:
        if settings_si(key, 0.0)[0] not in SETTINGS:
            raise InputError("there is no such setting of a dataset", value=key, limit=", ".join(SETTINGS))


def _in_shop_units(settings: Mapping[str, Any]) -> dict[str, Any]:
    return dict(settings_shop(key, value) for key, value in settings.items())


def _channel(name: str, values: Float, sigma: float | Float | None, columns: dict[str, list[str]]) -> dict[str, Any]:
    kind = channel_kind(name)
    array = _rows(name, kind, np.asarray(values, dtype=np.float64))
    count = array.shape[1]
    names = column_names(name, kind, count)
    factors = shop_factors(kind, count)
    columns.update(_texts(names, array / factors))
    units = list(dict.fromkeys(kind.file_units(count)))
    table: dict[str, Any] = {"columns": names}
    if set(units) != {"1"}:
        table["unit"] = units[0] if len(units) == 1 else units
    if kind.nature == "rotation":
        table["rotation"] = "rotation_vector"
    if sigma is None:
        return table
    spread = np.asarray(sigma, dtype=np.float64)
    if spread.ndim == 2:
        table["sigma_columns"] = [f"sigma_{column}" for column in names]
        columns.update(_texts(table["sigma_columns"], spread / factors))
    elif spread.ndim == 0 and len(units) == 1:
        table["sigma"] = float(f"{float(spread) / factors[0]:.{DIGITS}g}")
    else:
        table["sigma"] = [float(f"{v:.{DIGITS}g}") for v in np.broadcast_to(spread, (count,)) / factors]
    return table


def _rows(name: str, kind: ChannelKind, array: Float) -> Float:
    """Values (n, k) of a channel; rotations as rotation vectors."""
    if kind.nature == "rotation" and array.ndim == 3:
        array = rotation.log(array)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] not in kind.allowed:
        raise InputError("a channel has another shape", where=name, value=array.shape, limit=f"(n, {kind.allowed})")
    if not np.all(np.isfinite(array)):
        raise InputError("a channel holds a number that is not finite", where=name)
    return array


def _texts(names: Sequence[str], values: Float) -> dict[str, list[str]]:
    """Columns (n, k) as text, by name."""
    return {name: [f"{v:.{DIGITS}g}" for v in column] for name, column in zip(names, values.T, strict=True)}


def column_names(name: str, kind: ChannelKind, count: int) -> list[str]:
    """Names of a channel's columns as they are written: ``q1_deg``, ``p_tracker_target_x_mm``, ``time_s``."""
    out = []
    for part, unit in zip(kind.components[:count], kind.file_units(count), strict=True):
        suffix = _SUFFIX.get(unit, unit.lower().replace("/", "_").replace(" ", ""))
        middle = part if not part or part.isdigit() else f"_{part}"
        stem = f"{name}{middle}"
        out.append(stem if not suffix or stem.endswith(f"_{suffix}") else f"{stem}_{suffix}")
    return out


def shop_factors(kind: ChannelKind, count: int) -> Float:
    """SI value of one written unit of each component."""
    pairs = zip(kind.file_units(count), kind.si_units(count), strict=True)
    return np.array([UNITS.get(si, {si: 1.0})[unit] for unit, si in pairs])
