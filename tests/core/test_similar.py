"""Names that do not exist lead to the nearest that do: materials, robots, settings, anything that lists its names."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to, did_you_mean
from counterflex.cutting import material
from counterflex.robot.model import catalog


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("en-aw-7075-vdi2", "en-aw-7075-vdi22"),
        ("en_aw_7057_vdi22", "en-aw-7075-vdi22"),
        ("EN AW-7075 VDI22", "en-aw-7075-vdi22"),
        ("ENAW6082", "6082"),
        ("7075", "7075"),
        ("C45", "c45"),
        ("s275", "s275jr"),
        ("stainles", "stainless"),
        ("inconell", "inconel"),
    ],
)
def test_a_misspelt_material_leads_to_the_one_that_was_meant(wrong: str, meant: str) -> None:
    with pytest.raises(InputError, match="Did you mean") as caught:
        material.load(wrong)
    assert meant in str(caught.value.hint)


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [("kr300 r2500", "kuka_kr300_r2500_ultra"), ("abb_irb6700", "abb_irb6700_235_265"), ("staubli_m99", "staubli_")],
)
def test_a_misspelt_robot_too(wrong: str, meant: str) -> None:
    with pytest.raises(InputError) as caught:
        catalog.entry(wrong)
    assert caught.value.data["nearest"][0].startswith(meant)


@pytest.mark.parametrize(
    ("value", "limit", "meant"),
    [
        ("modrn", "modern, classic or other", "modern"),
        ("rxx", "dx dy dz rx ry rz", "rx"),
        ("wid", "one of mild, wide, other", "wide"),
        ("'kinematcs'", "'kinematics', 'play'", "kinematics"),
    ],
)
def test_every_error_that_lists_names_asks_for_the_nearest(value: str, limit: str, meant: str) -> None:
    assert InputError("unknown name", value=value, limit=limit).hint == f"Did you mean {meant!r}?"
    assert InputError("unknown name", value=value, limit=limit, hint="Look there").hint == "Look there"
    assert InputError("out of range", value=value, limit=limit).hint is None
    assert InputError("unknown name", value="xyzzy", limit=limit).hint is None


def test_what_is_far_is_not_offered() -> None:
    assert close_to("zzz", ["abc", "def"]) == []
    assert did_you_mean("zzz", ["abc"]) is None
    assert close_to("FEED", ["feed", "speed"])[0] == "feed"


@given(st.lists(st.text("abcxyz", max_size=9), min_size=1, max_size=8, unique=True), st.integers(1, 4))
def test_of_names_that_contain_it_the_shortest_come_first(tails: list[str], count: int) -> None:
    """Case, blanks and punctuation apart; not more than asked for."""
    names = [f"KR-300 {tail}" for tail in tails]
    found = close_to("kr300", names, count)
    assert len(found) == min(count, len(names))
    assert [len(name) for name in found] == sorted(len(name) for name in names)[: len(found)]


@given(
    st.permutations(["FFWOF", "FFWON", "FFWOX", "other ffwo", "ffwo last"]), st.sampled_from(["FFWO", "FFVO", "LAZT"])
)
def test_the_order_in_which_names_are_listed_does_not_count(names: list[str], wrong: str) -> None:
    assert close_to(wrong, names) == close_to(wrong, sorted(names))
