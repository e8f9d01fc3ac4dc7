"""Mistakes put into the pulls of a real robot, which fit to a fifth only: each is refused, whatever the priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.stiffness import recipe as stiffness

EXAMPLES = Path(__file__).parents[3] / "examples"
CELL = model_of(read_cell(EXAMPLES / "cells" / "fanuc_r2000ic.toml"))
DATA = read_dataset(EXAMPLES / "data" / "fanuc_r2000ic_stiffness" / "pulls.toml")
WIDE: Mapping[str, str | bool] = {"wide": "all"}


def _with(channel: str, change: Callable[[Float], Float], sigma: float = 1.0) -> Dataset:
    old = DATA.channel(channel)
    new = replace(old, values=change(old.values), sigma=old.need_sigma() * sigma)
    return replace(DATA, channels={**DATA.channels, channel: new})


ONE_SIGN = _with("f_tcp_base", lambda f: f * [1.0, -1.0, 1.0])
ROWS = _with("d_tcp_base", lambda d: np.roll(d, 1, axis=0))


@pytest.mark.by_turn
@pytest.mark.parametrize(
    ("data", "prior", "says"),
    [
        (ONE_SIGN, {}, r"sign of 'f_tcp_base' \(fy\)"),
        (ONE_SIGN, WIDE, r"sign of 'f_tcp_base' \(fy\)"),
        (ROWS, {}, "one row late"),
        (ROWS, WIDE, "one row late"),
        (_with("f_tcp_base", lambda f: -f), WIDE, "negative work"),
        (_with("d_tcp_base", lambda d: 1e-3 * d, 1e-3), WIDE, "worse than by no deflection"),
        (_with("d_tcp_base", lambda d: 1e3 * d, 1e3), WIDE, "1000 times too large"),
    ],
    ids=["one sign", "one sign, wide", "rows", "rows, wide", "all signs", "m read as mm", "mm read as m"],
)
def test_mistake_is_refused(data: Dataset, prior: Mapping[str, str | bool], says: str) -> None:
    with pytest.raises(InputError, match=says):
        stiffness.RECIPE.identify(CELL, [data], [], {"regions": False, **prior}, silent)
