"""Shift the tracker's frame of a cell file so that it sees the tool, on average, where the controller has it.

A laboratory does this by touching the part with robot and tracker: sag and errors of the arm, a few millimetres
at the part, would else count as a wrong frame. Used by the jobs of tools/digest.py.

    python tools/digest_register.py WATCHED.csv CELL.toml OUT.toml
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import polars as pl

from counterflex.files.cell.cell import read_cell


def main() -> None:
    """Mean of commanded minus tracked position, part axes, added to [tracker] in base axes."""
    log, cell, out = map(Path, sys.argv[1:])
    rows = pl.read_csv(log)
    sets = [rows.select(f"{name}_{axis}" for axis in "xyz").to_numpy() for name in ("nominal", "actual")]
    away = sets[0] - sets[1]
    seen = np.all(np.isfinite(away), axis=1) & np.any(sets[1] != 0.0, axis=1)
    shift = read_cell(cell).T_base_part[:3, :3] @ away[seen].mean(axis=0)
    head, tracker = cell.read_text().split("[tracker]")
    for axis, by in zip("xyz", shift, strict=True):
        old = re.search(rf"(?m)^{axis}_mm = (\S+)", tracker)
        if old is None:
            raise SystemExit(f"{cell}: [tracker] has no {axis}_mm")
        tracker = tracker.replace(old[0], f"{axis}_mm = {float(old[1]) + 1e3 * by:.6f}", 1)
    out.write_text(f"{head}[tracker]{tracker}")


if __name__ == "__main__":
    main()
