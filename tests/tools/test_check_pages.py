"""What the page check calls wrong; the browser itself is run by ``make pages``."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

GOOD: dict[str, Any] = {
    "width": 360, "scroll": 360, "wide": [], "empty": [], "small": [], "pale": [], "cut": [], "over": [], "faults": [],
}  # fmt: skip


@pytest.fixture(scope="module")
def check_pages() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "check_pages.py"
    spec = importlib.util.spec_from_file_location("check_pages", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_page_that_fits_has_no_faults(check_pages: ModuleType) -> None:
    assert check_pages.faults(GOOD) == []


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("scroll", 412, "412 px wide"),
        ("wide", ["DIV.card"], "runs off the page: DIV.card"),
        ("empty", ["map"], "not drawn: map"),
        ("small", ["TD 7"], "too small to read: TD 7"),
        ("pale", ["TD 0.31 2.1"], "too pale to read: TD 0.31 2.1"),
        ("cut", ["map: 0.31 mm"], "label cut off: map: 0.31 mm"),
        ("over", ["map: 1 and 2"], "map: 1 and 2"),
        ("faults", ["x is not defined"], "script: x is not defined"),
    ],
)
def test_each_fault_is_named(key: str, value: Any, said: str, check_pages: ModuleType) -> None:
    assert any(said in fault for fault in check_pages.faults({**GOOD, key: value}))
