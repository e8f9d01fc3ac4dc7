"""Columns of material on disk: a compressed NumPy archive of the stretches that there are."""

from __future__ import annotations

import os
from typing import Final

import numpy as np

from counterflex.core.atomic import atomic_path
from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import arrays
from counterflex.cutting.tridexel.column_block_kernels import STRETCHES
from counterflex.cutting.tridexel.columns import ColumnStock

FORMAT: Final = "counterflex-columns"
VERSION: Final = 1


def save_columns(stock: ColumnStock, path: str | os.PathLike[str]) -> None:
    """Write columns, whole or not at all: as many layers of stretches as the fullest column holds.

    Raises:
        OutputError: The folder cannot be written.
    """
    layers = int(stock.count.max(initial=0))
    with atomic_path(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream,
            format=np.array(FORMAT),
            version=np.array(VERSION),
            origin_m=np.array([stock.x0_m, stock.y0_m]),
            cell_m=np.array(stock.cell_m),
            low_m=np.ascontiguousarray(stock.low[:layers]),
            high_m=np.ascontiguousarray(stock.high[:layers]),
            count=stock.count,
        )


def load_columns(path: str | os.PathLike[str]) -> ColumnStock:
    """Read what :func:`save_columns` wrote.

    Raises:
        FileFormatError: The file is missing, holds no columns, or was written by a newer version.
    """
    with arrays(path, "a file of columns of material", "simulate writes one") as data:
        if "format" not in data or str(data["format"]) != FORMAT:
            raise FileFormatError("not a file of columns of material", where=str(path))
        if int(data["version"]) > VERSION:
            raise FileFormatError(
                "columns were written by a newer version",
                where=str(path),
                value=int(data["version"]),
                limit=f"<= {VERSION}",
            )
        x0, y0 = (float(value) for value in data["origin_m"])
        count = np.asarray(data["count"], np.uint8)
        low, high = (np.zeros((max(STRETCHES, len(data["low_m"])), *count.shape), np.float32) for _ in range(2))
        low[: len(data["low_m"])], high[: len(data["high_m"])] = data["low_m"], data["high_m"]
        return ColumnStock(x0, y0, float(data["cell_m"]), low, high, count)
