"""Summarise a dataset as identification will read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.writer import shop_factors
from counterflex.geometry import rotation
from counterflex.identify.data.channels import CHANNELS
from counterflex.identify.stiffness.frame_pulls import summary


class DatasetSummary(Summary):
    """Channels of a dataset, their ranges and what is missing."""

    def _shown(self) -> Parts:
        before = [None, *(row["channel"] for row in self["channels"])]
        yield ShownTable.of(
            self.line("{name}: {kind}, {rows} rows in {groups} groups"),
            "channel=own | number=component | unit | least=low:.6g | mean:.6g | largest=high:.6g | "
            "standard deviation=sigma",
            [
                row | {"own": row["channel"] if row["channel"] != last else ""}
                for row, last in zip(self["channels"], before, strict=False)
            ],
            self.line("Lines {lines[0]} to {lines[1]} of {file}. SHA-256 {sha256}"),
        )
        yield from (f"setting: {key} = {value}" for key, value in self["settings"].items())
        yield from (f"measuring frame: {line}" for line in (self["frame"] or {"lines": ()})["lines"])
        if self["without_sigma"]:
            yield self.line("no standard deviation: {without_sigma}; a recipe that weighs one will ask for it")
        yield "dataset ok"


def described(path: str | Path) -> DatasetSummary:
    """Read a dataset and summarise it in shop units.

    Returns:
        ``name``, ``kind``, ``rows``, ``groups``, ``file``, ``lines``, ``sha256``, ``settings``, ``channels`` (range,
        mean and standard deviation of every number), ``without_sigma`` (names), ``frame`` (what the sensors of a
        measuring frame say, or None; see :func:`counterflex.identify.stiffness.frame_pulls.summary`).

    Raises:
        FileFormatError: The dataset cannot be read.
        InputError: The sensors of its measuring frame do not show a motion, or contradict each other.
    """
    data = read_dataset(path)
    rows = []
    for name, channel in data.channels.items():
        kind = CHANNELS[name]
        values = rotation.log(channel.values) if channel.values.ndim == 3 else channel.values
        count = values.shape[1]
        factors, units = shop_factors(kind, count), kind.file_units(count)
        for k in range(count):
            column = values[:, k] / factors[k]
            spread = None if channel.sigma is None else channel.sigma[:, k] / factors[k]
            rows.append(
                {
                    "channel": name,
                    "component": kind.components[k],
                    "unit": units[k],
                    "low": float(np.min(column)),
                    "mean": float(np.mean(column)),
                    "high": float(np.max(column)),
                    "sigma": "" if spread is None else _range(float(np.min(spread)), float(np.max(spread))),
                }
            )
    answer = {
        "name": data.name,
        "kind": data.kind,
        "rows": len(data),
        "groups": len(np.unique(data.group)),
        "file": Path(data.file).name,
        "lines": [int(data.line[0]), int(data.line[-1])],
        "sha256": data.fingerprint,
        "settings": dict(data.settings),
        "channels": rows,
        "frame": summary(data),
        "without_sigma": [name for name, c in data.channels.items() if c.sigma is None],
    }
    return DatasetSummary(answer)


def _range(low: float, high: float) -> str:
    return f"{low:.3g}" if high <= low * (1.0 + 1e-9) else f"{low:.3g} to {high:.3g}"
