"""What a dataset holds, as identification will read it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.writer import shop_factors
from counterflex.geometry import rotation
from counterflex.identify.data.channels import CHANNELS
from counterflex.identify.stiffness.frame_pulls import summary


def described(path: str | Path) -> dict[str, Any]:
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
    return {
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


def _range(low: float, high: float) -> str:
    return f"{low:.3g}" if high <= low * (1.0 + 1e-9) else f"{low:.3g} to {high:.3g}"
