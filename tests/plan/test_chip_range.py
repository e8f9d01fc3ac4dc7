"""Chips outside the range of the constants: ordinary ways into the material pass with their effect, in um."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.compensation.headline import WARNED_SHARE, extrapolation, extrapolation_text
from counterflex.app.examples import small
from counterflex.core.errors import ModelError
from counterflex.core.similar import told_apart
from counterflex.core.units import MM, UM
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.chip_range import UNCERTAIN_SHARE, check, outside, uncertainty

PROGRAM = Path(__file__).parents[2] / "examples" / "programs" / "helix_ramp_return.ngc"
KIENZLE = KienzleLaw.from_k11(
    780e6, 0.27, kr11_pa=273e6, mr=0.27, ka11_pa=117e6, ma=0.27, h_min_m=0.01 * MM, h_max_m=0.1 * MM,
    source="test", status="assumed",
)  # fmt: skip


def test_the_uncertainty_is_that_of_the_closed_form() -> None:
    h = np.array([0.0, 0.005, 0.01, 0.05, 0.1, 0.3]) * MM
    assert uncertainty(KIENZLE, h) == pytest.approx([0.0, 1 - 0.5**0.27, 0.0, 0.0, 0.0, 3**0.27 - 1], abs=1e-12)
    linear = LinearEdgeLaw(600e6, 0.0, 0.0, 20e3, 0.0, 0.0, 0.01 * MM, 0.1 * MM, "test", "assumed")
    at, edge = 600e6 * 0.005 * MM + 20e3, 600e6 * 0.01 * MM + 20e3
    assert uncertainty(linear, h[1:2]) == pytest.approx(abs(at - edge * 0.5) / at)
    for law in (KIENZLE, linear):
        one = uncertainty(law, np.geomspace(0.01, 0.0001, 30) * MM)
        assert np.all(np.diff(one) > 0.0)  # the farther, the less is known
        assert np.all(one < 1.0)


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    (folder / "cell.toml").write_text(small(), encoding="utf-8")
    return folder / "cell.toml"


def _of_material(cell_file: Path, name: str) -> Cell:
    head, rest = cell_file.read_text(encoding="utf-8").split("[material]\n")
    after = rest[rest.index("\n[") :]
    other = cell_file.with_name(f"{name}.toml")
    table = f'[material]\ncatalog = "{name}"\nkr_over_kc = 0.35\nka_over_kc = 0.15\n'
    other.write_text(head + table + after, encoding="utf-8")
    return read_cell(other)


@pytest.mark.by_turn
@pytest.mark.parametrize("name", [None, "en-aw-7075-berger-measured", "en-aw-2017-vdi22", "c45-normalised-vdi2"])
def test_a_helix_a_ramp_and_a_return_move_at_high_feed_pass(cell_file: Path, name: str | None) -> None:
    """Constants of the example and of the catalogue; outside their range the effect is said in um."""
    cell = read_cell(cell_file) if name is None else _of_material(cell_file, name)
    result = compensate(PROGRAM, cell)
    found = result.summary["prediction"]["extrapolation"]
    law, plan = cell.force_law, result.plan
    assert found == extrapolation(plan, law)
    text = extrapolation_text(found)
    if found is None:
        assert text == ""
        return
    assert text.startswith("warning: " if found["force_share"] > WARNED_SHARE else "note: ")
    assert f"wrong by {found['effect_um']:.2g} um" in text
    assert plan.chip_m is not None
    largest = max(
        float(uncertainty(law, plan.chip_m[row : row + 1])[0] * np.linalg.norm(plan.deflection_part[row, :3]))
        for row in np.flatnonzero(plan.extrapolated)
    )
    assert found["effect_um"] == pytest.approx(largest / UM, abs=0.01)
    if name is not None:
        assert found["effect_um"] > 0.0


def test_a_force_that_is_uncertain_as_a_whole_is_refused_with_a_limit_that_differs() -> None:
    n = 100
    chip, w, t = np.full(n, 1e-9), np.zeros((n, 6)), np.arange(n, dtype=float)
    w[:, 0] = 100.0
    least = 0.01 * MM * (1.0 - UNCERTAIN_SHARE) ** (1 / 0.27)
    for factor, refused in ((1.0001, False), (0.9999, True)):
        chip[:] = factor * least
        found = outside(KIENZLE, chip, np.ones(n, dtype=bool), w, t)
        if not refused:
            check(found, KIENZLE, chip, 0, "part.ngc:8")
            continue
        with pytest.raises(ModelError, match=r"part\.ngc:8: .*50\.00\d+ % .*at most 50 %"):
            check(found, KIENZLE, chip, 0, "part.ngc:8")


@pytest.mark.parametrize(
    ("value", "limit", "texts"),
    [
        (2.02, 2.0, ("2.02", "2")),
        (3.0, 2.0, ("3", "2")),
        (25.0004, 25.0, ("25.0004", "25")),
        (0.1, 0.25, ("0.1", "0.25")),
    ],
)
def test_value_and_limit_are_told_apart(value: float, limit: float, texts: tuple[str, str]) -> None:
    assert told_apart(value, limit) == texts
    smallest = math.nextafter(limit, math.inf)
    assert len(set(told_apart(smallest, limit))) == 2
