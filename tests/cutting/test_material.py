"""Materials: provenance of every row, reference thickness, Victor factors against FreeCAD's cards, ranges."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.units import DEG, MM, N_PER_MM, N_PER_MM2
from counterflex.cutting import material
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw, check_thickness
from counterflex.cutting.material import VictorFactors, rake_factor


def test_every_row_says_where_it_comes_from_and_makes_a_law() -> None:
    assert len(material.names()) >= 50
    for name in material.names():
        row = material.load(name)
        assert row.source
        assert row.h_range_basis
        assert 0.0 < row.h_min_m < row.h_max_m < 3 * MM
        law = row.with_ratios(
            kr_over_kc=0.4 if row.radial is None else None, ka_over_kc=0.1 if row.axial is None else None
        )
        forces = law.edge_force(np.array([0.02, 0.1, 0.5]) * MM)
        assert np.all(np.diff(forces[:, 0]) > 0.0)
        assert ("assumed" in law.status) == (row.radial is None or row.axial is None)


def test_k11_is_stored_at_its_reference_thickness() -> None:
    law = material.load("en-aw-7075-berger-measured").with_ratios(kr_over_kc=0.3, ka_over_kc=0.1)
    assert isinstance(law, KienzleLaw)
    assert law.h_ref_m == pytest.approx(math.sqrt(0.01 * 0.03) * MM)
    assert law.k11_pa()[0] == pytest.approx(776e6)
    # b = 1 mm, h = 1 mm gives k_c1.1 in N; forgetting the 1 mm in SI would give 1000^0.274 = 6.6 times as much
    assert law.edge_force(1 * MM)[0] * 1 * MM == pytest.approx(776.0)
    assert law.edge_force(0.02 * MM)[0] / (0.02 * MM) == pytest.approx(776e6 * 0.02**-0.274)
    moved = law.at_reference(0.3 * MM)
    np.testing.assert_allclose(moved.edge_force(0.017 * MM), law.edge_force(0.017 * MM), rtol=1e-13)


def test_sources_of_7075_agree_at_milling_thickness() -> None:
    """k_c1.1 of four independent sources spreads from 278 to 800 N/mm2, k_c(0.02 mm) by 8 %."""
    rows = ("en-aw-7075-berger-literature", "en-aw-7075-berger-measured", "en-aw-7075-vdi22", "en-aw-7075-carbide-190")
    specific = []
    for name in rows:
        k, m = material.load(name).cutting
        specific.append(k * 0.02**-m / N_PER_MM2)
    assert specific == pytest.approx([1918, 2267, 2127, 2219], abs=2)


@pytest.mark.parametrize(
    ("name", "card"),
    [
        ("al-wrought-soft-tabellenbuch", 641),
        ("al-cast-hard-tabellenbuch", 927),
        ("steel-mild-tabellenbuch", 2298),
        ("steel-low-alloy-tabellenbuch", 2809),
        ("stainless-austenitic-tabellenbuch", 2553),
        ("en-gjl-250-tabellenbuch", 1286),
    ],
)
def test_factors_give_freecads_milling_cards(name: str, card: float) -> None:
    """A card is the value at zero rake that, corrected to gamma_0, is the table value times 1.2 for milling."""
    row = material.load(name)
    assert row.base_rake_rad is not None
    factors = VictorFactors(k_gamma=1.0 / rake_factor(row.base_rake_rad, 0.0), k_st=1.2)
    law = row.with_ratios(kr_over_kc=0.3, ka_over_kc=0.1, factors=factors)
    assert isinstance(law, KienzleLaw)
    assert law.k11_pa()[0] / N_PER_MM2 == pytest.approx(card, abs=1.0)


def test_rake_factor_of_aluminium_depends_on_the_base_rake() -> None:
    assert rake_factor(12 * DEG, 0.0) == pytest.approx(0.88)
    assert rake_factor(12 * DEG, 12 * DEG) == 1.0
    with pytest.raises(InputError, match="degrees"):
        rake_factor(12.0, 0.0)
    with pytest.raises(InputError):
        VictorFactors(k_ver=0.0)


def test_unknown_directions_are_never_invented() -> None:
    row = material.load("en-aw-2017-vdi22")
    with pytest.raises(ModelError, match="no radial and no axial"):
        row.law()
    with pytest.raises(ModelError, match="ka_over_kc"):
        row.with_ratios(kr_over_kc=0.35)
    with pytest.raises(InputError, match="of its own"):
        material.load("en-aw-7075-carbide-190").with_ratios(kr_over_kc=0.3)
    assert isinstance(material.load("en-aw-7075-linear-190").law(), LinearEdgeLaw)


def test_linear_edge_row_and_its_kienzle_fit_agree_within_the_stated_deviation() -> None:
    linear = material.load("en-aw-7075-linear-190").law()
    fitted = material.load("en-aw-7075-carbide-190").law()
    h = np.geomspace(0.01, 0.1, 30) * MM
    ratio = fitted.edge_force(h) / linear.edge_force(h)
    assert np.abs(ratio - 1.0).max(axis=0) == pytest.approx([0.095, 0.065, 0.042], abs=0.01)
    assert isinstance(linear, LinearEdgeLaw)
    assert linear.kte_n_m == pytest.approx(27.7 * N_PER_MM)


def test_no_silent_extrapolation() -> None:
    law = material.load("en-aw-7075-carbide-190").law()
    assert check_thickness(law, 0.02 * MM)
    assert not check_thickness(law, 0.004 * MM, allow_extrapolation=True)
    with pytest.raises(ModelError, match=r"0\.01 to 0\.1 mm"):
        check_thickness(law, 0.004 * MM, where="part.ngc:12")


@pytest.mark.parametrize(
    "change",
    [{"kc_ref_pa": -1.0}, {"kc_ref_pa": math.nan}, {"mc": 1.2}, {"h_ref_m": 0.0}, {"h_min_m": 0.2 * MM}],
)
def test_bad_coefficients_are_refused(change: dict[str, float]) -> None:
    numbers = {
        "kc_ref_pa": 2e9,
        "mc": 0.25,
        "kr_ref_pa": 7e8,
        "mr": 0.25,
        "ka_ref_pa": 3e8,
        "ma": 0.25,
        "h_ref_m": 0.02 * MM,
        "h_min_m": 0.01 * MM,
        "h_max_m": 0.1 * MM,
    } | change
    with pytest.raises(InputError):
        KienzleLaw(**numbers, source="test", status="assumed", edge_n_m=(0.0, 0.0, 0.0))


HEADER = "name,material,number,kc11_n_mm2,mc,kr11_n_mm2,mr,ka11_n_mm2,ma,h_min_mm,h_max_mm,h_range_basis,gamma0_deg"
ROW = "mine,AlMg,3.3,780,0.25,300,0.3,100,0.3,0.01,0.2,tests,12"


@pytest.mark.parametrize(
    ("columns", "values", "what"),
    [
        (",status,conditions,source", ",measured,dry,me", ""),
        (",status,conditions", ",measured,dry", "lacks a column; got source"),
        (",status,conditions,source", ",measured", "lacks a column; got conditions, source"),
        (",status,conditions,source", ",guessed,dry,me", "lacks its cutting coefficient, source or status"),
    ],
)
def test_a_table_of_another_package_is_read_or_refused_in_one_line(
    tmp_path: Path, columns: str, values: str, what: str
) -> None:
    file = tmp_path / "others.csv"
    file.write_text(f"{HEADER}{columns}\n{ROW}{values}\n", encoding="utf-8")
    if not what:
        assert material._rows([file], {})["mine"].cutting == (780 * N_PER_MM2, 0.25)
        file.write_text(f"{HEADER}{columns}\n{ROW.replace('780', 'inf')}{values}\n", encoding="utf-8")
        what = "not finite"
    with pytest.raises(FileFormatError, match=f"others.csv:2: .*{what}"):
        material._rows([file], {})


def test_unknown_material_suggests_names() -> None:
    with pytest.raises(InputError, match="en-aw-7075"):
        material.load("en-aw-7075-vdi")


def test_edge_force_is_zero_out_of_cut() -> None:
    law = material.load("en-aw-7075-linear-190").law()
    assert np.all(law.edge_force(np.array([0.0, -1e-6])) == 0.0)
    assert law.edge_force(1e-12)[0] == pytest.approx(27.7 * N_PER_MM)


def test_edge_force_of_kienzle_law_is_added_at_every_thickness() -> None:
    plain = KienzleLaw.with_ratios(
        780e6, 0.25, kr_over_kc=0.35, ka_over_kc=0.15, h_min_m=1e-6, h_max_m=1e-3, source="test"
    )
    dull = replace(plain, edge_n_m=(2000.0, 1500.0, 0.0))
    h = np.array([1e-6, 2e-5, 1e-3])
    np.testing.assert_allclose(
        dull.edge_force(h) - plain.edge_force(h), np.tile([2000.0, 1500.0, 0.0], (3, 1)), atol=1e-9
    )
    np.testing.assert_allclose(dull.scaled(2.0).edge_force(h), 2.0 * dull.edge_force(h))
    assert plain.terms().shape == (1, 4)
