"""Identification: what to measure, and what measurements say of the cell."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from counterflex.api.cell import Cell, file_of, read_cell
from counterflex.app.identification import identify as job, propose as proposing
from counterflex.core import atomic, file_content
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Result
from counterflex.files.dataset.units import factor
from counterflex.files.dataset.writer import write_dataset
from counterflex.files.identification_file import read_identification
from counterflex.identify.data.channels import channel_kind
from counterflex.identify.recipes import RECIPES

if TYPE_CHECKING:
    import polars as pl

Arrays = Mapping[str, Any]
"""Channels of one dataset in SI or shop units, see :func:`identify`."""

_UNIT_OF_SUFFIX: Final = {
    "deg": "deg", "rad": "rad", "mrad": "mrad", "mm": "mm", "um": "um", "m": "m", "n": "N", "kn": "kN", "nm": "N m",
    "s": "s", "ms": "ms", "us": "us", "rpm": "rpm", "mm_min": "mm/min", "mm_s": "mm/s", "c": "degC", "a": "A",
    "v_v": "V/V", "mv_v": "mV/V",
}  # fmt: skip
"""Units by the suffix that names them."""
_SIGMA: Final = "sigma_"


class Identification(Result):
    """Identified parameters, with the cell that has them.

    Attributes:
        folder: Holds ``cell.toml``, ``result.json`` and ``report.html``.
    """

    def __init__(self, result: dict[str, Any], folder: Path) -> None:
        self._result, self.folder = result, folder

    @property
    def cell(self) -> Cell:
        """The cell with what was found."""
        return read_cell(self.folder / job.CELL)

    @property
    def table(self) -> pl.DataFrame:
        """One row per parameter: value with 95 % interval, nominal and prior, and whether the data determine it."""
        import polars as pl

        keys = ("name", "label", "unit", "nominal", "value", "sigma", "low", "high", "prior_sigma", "seen")
        rows = [
            {"fit": fit, **{key: row.get(key) for key in keys}}
            for fit, values in self._result["fits"].items()
            for row in values["parameters"]
            if row["free"]
        ]
        return pl.DataFrame(rows, infer_schema_length=None, strict=False)

    @property
    def figures(self) -> dict[str, float]:
        """Further figures by name, in the unit that the name states."""
        return {one["name"]: one["value"] for one in self._result["figures"]}

    @property
    def summary(self) -> dict[str, Any]:
        """Content of ``result.json``."""
        return self._result

    def save(self, folder: str | Path) -> Path:
        """Copy ``cell.toml``, ``result.json`` and ``report.html`` into a folder."""
        with atomic.atomic_folder(folder) as staging:
            for name in (job.CELL, job.RESULT, job.REPORT):
                atomic.write_bytes(staging / name, file_content.content(self.folder / name))
        return Path(folder)

    def _lines(self) -> list[str]:
        head = [
            f"{one['text']}: {one['value']:.3g}"
            + ("" if one["nominal"] is None else f", with the cell file {one['nominal']:.3g}")
            for one in self._result["headline"]
        ]
        return [f"{self._result['recipe']}: {self._result['outcome']}", *head]


def propose(
    recipe: str,
    count: int,
    cell: Cell | str | Path,
    out: str | Path,
    *,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Choose measurements that determine the parameters of a recipe, and write them down.

    Args:
        recipe: As ``counterflex identify --help`` names it.
        count: Number of measurements.
        cell: Cell, or cell file.
        out: Folder for ``proposal.toml``, ``proposal.csv`` and a form to fill.
        seed: Of what is drawn.

    Returns:
        ``expected``: standard deviation of every parameter, beforehand; ``remarks``; ``files``.

    Raises:
        CounterflexError: The cell does not allow it.
    """
    return proposing.run(_known(recipe), count, file_of(cell), out, settings=settings or {}, seed=seed)


def identify(
    recipe: str,
    data: str | Path | Arrays | Sequence[str | Path | Arrays],
    cell: Cell | str | Path,
    out: str | Path,
    *,
    holdout: Sequence[str | Path | Arrays] = (),
    settings: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Identification:
    """Identify parameters of the cell from measurements; writes the new cell file into a folder.

    Args:
        recipe: ``stiffness``, ``kinematics``, ``cutting`` ...: as ``counterflex identify --help`` names it.
        data: Manifests of datasets, or arrays: a mapping with ``kind`` (docs/datasets.md) and one array per channel,
            whose key is the channel and its unit: ``q_deg`` (n, 6), ``d_tcp_base_mm`` (n, 3), ``f_tcp_base_n`` (n, 3).
            ``sigma_`` before it is the standard deviation: one number or one per component. ``group`` (n,) joins rows
            that belong together, ``settings`` holds the settings of the dataset.
        cell: Cell, or cell file.
        out: Folder for ``cell.toml``, ``result.json`` and ``report.html``.
        holdout: Data that are only predicted.
        progress: Called with the share done, 0 to 1.

    Raises:
        CounterflexError: Data that do not fit, or a result that is worse than the cell file.
    """
    several = [data] if isinstance(data, str | Path | Mapping) else list(data)
    with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
        fitted, unseen = (
            [_manifest(one, Path(scratch), f"{name}{k + 1}") for k, one in enumerate(some)]
            for name, some in (("arrays", several), ("holdout", holdout))
        )
        job.run(_known(recipe), fitted, file_of(cell), out, holdout=unseen, settings=settings, progress=progress)
    return Identification(read_identification(Path(out) / job.RESULT), Path(out))


def _known(recipe: str) -> str:
    if recipe not in RECIPES:
        raise InputError("there is no such recipe", value=recipe, limit=", ".join(RECIPES))
    return recipe


def _manifest(data: str | Path | Arrays, folder: Path, name: str) -> Path:
    """Write arrays as a dataset; a file stays."""
    if not isinstance(data, Mapping):
        return Path(data)
    channels: dict[str, Any] = {}
    sigma: dict[str, Any] = {}
    for key, values in data.items():
        if key in ("kind", "group", "settings"):
            continue
        channel, unit = _channel(key.removeprefix(_SIGMA))
        kind = channel_kind(channel)
        array = np.asarray(values, dtype=np.float64)
        given = sigma if key.startswith(_SIGMA) else channels
        count = array.shape[-1] if array.ndim > (given is channels) else 1
        scale = np.array([factor(unit or si, si, key) for si in kind.si_units(count)])
        given[channel] = array * (scale if array.ndim > (given is channels) else scale[0])
    group = data.get("group")
    return write_dataset(
        folder,
        name,
        str(data.get("kind", "")),
        channels,
        sigma,
        group=None if group is None else np.asarray(group, dtype=np.int64),
        settings=data.get("settings"),
    )


def _channel(key: str) -> tuple[str, str | None]:
    """Channel and unit that a key names; None: the channel itself is named with its unit."""
    for suffix in sorted(_UNIT_OF_SUFFIX, key=len, reverse=True):
        if key.endswith(f"_{suffix}"):
            channel = key.removesuffix(f"_{suffix}")
            try:
                channel_kind(channel)
            except InputError:
                continue
            return channel, _UNIT_OF_SUFFIX[suffix]
    channel_kind(key)
    return key, None
