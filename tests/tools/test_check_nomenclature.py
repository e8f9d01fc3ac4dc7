"""The nomenclature check finds what it should and leaves alone what is explained."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]

PAGE = """
## Unit suffixes

| suffix | unit |
|---|---|
| `_m` | m |
| `_m_s` | m/s |

## Frame names

| name | meaning |
|---|---|
| `T_a_b` | pose |

## Names

| name | unit |
|---|---|
| `phi`, `q` | rad |
"""


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_nomenclature", ROOT / "tools" / "check_nomenclature.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["check_nomenclature"] = module
    spec.loader.exec_module(module)
    return module


def _names(source: str) -> list[str]:
    return [item.name for item in _load().quantities(source, "module.py")]


def test_numbers_of_public_functions_methods_and_classes_are_collected() -> None:
    source = (
        "def f(a: float, b: int, c: Float | None, d: str, *, e: tuple[float, ...]) -> float: ...\n"
        "class K:\n    g: Float\n    h: int\n    def m(self, i: float) -> None: ...\n"
    )
    assert _names(source) == ["a", "c", "e", "g", "i"]


def test_a_modules_own_names_for_numbers_count() -> None:
    source = (
        "Positive = Annotated[float, Field(gt=0.0)]\nWord = Annotated[str, 1]\n"
        "class K:\n    a: Positive | None\n    b: Word\n"
    )
    assert _names(source) == ["a"]


def test_private_names_kernels_and_callables_are_left_out() -> None:
    source = (
        "def _f(a: float) -> None: ...\n"
        "@kernel('void(float64)')\ndef k(b: float) -> None: ...\n"
        "def g(c: Callable[[float], float]) -> None: ...\n"
        "class _C:\n    d: float\n"
        "class D:\n    _e: float\n"
        "local: float = 0.0\n"
    )
    assert _names(source) == []


def test_suffixes_frames_and_listed_names_are_explained_and_nothing_else() -> None:
    page = _load().read_page(PAGE)
    for name in ("depth_m", "feed_m_s", "T_base_tcp", "phi", "q"):
        assert page.explains(name), name
    for name in ("depth", "_m", "R_base_tcp", "depth_mm", "T"):
        assert not page.explains(name), name
    assert page.suffix("feed_m_s") == "_m_s"


def test_what_the_page_lists_in_vain_is_reported() -> None:
    assert _load().read_page(PAGE).unused({"depth_m", "phi"}) == ["T_", "_m_s", "q"]


def test_cell_keys_are_collected_through_lists_and_optional_tables() -> None:
    tool = _load()
    assert {"robot", "rx_urad_per_knm", "a1_mm", "flutes", "box_min_mm", "wrist_singularity_deg"} <= tool.cell_keys()
    assert tool.missing_keys("| key | |\n| `a`, `b` | `c` |\n| `d e` | |\n", {"a", "b", "c", "d", "e"}) == ["c"]


def test_a_default_that_no_table_has_is_reported() -> None:
    tool = _load()
    text = "| key | | |\n| `a` | x | 2 |\n| `b`, `c` | y | 1, 3 |\n| `d` | z | none |\n| `e` | | 5 |\n"
    assert tool.wrong_defaults(text, {"a": {1.0, 2.0}, "b": {1}, "c": {2.0}, "d": {4.0}, "e": {None}}) == [
        "`c` is 2.0 where nothing is given, not 3"
    ]
    page = (tool.ROOT / "docs" / "cell-file.md").read_text(encoding="utf-8")
    assert tool.wrong_defaults(page.replace("| 0.3 |", "| 0.4 |"), tool.defaults_of())


def test_truth_keys_are_collected_through_tables_and_lists() -> None:
    assert _load().truth_keys({"a": 1, "b": [{"c": [1.0]}, {"d": {"e": 2}}]}) == {"a", "b", "c", "d", "e"}


def test_a_retired_word_is_refused_with_what_to_write() -> None:
    words = {r"\bundone\b": "compensation"}
    found = _load().retired_words("one line\nplay is undone here\nabundonement", "docs/page.md", words)
    assert found == ["docs/page.md:2: 'undone' is retired; write: compensation"]


def test_a_retired_name_is_refused_in_code_and_not_in_a_sentence() -> None:
    source = 'def _found(told, text):\n    """What was found."""\n    self.came = text\n    return told\n'
    faults = _load().retired_names(source, "src/a.py", {"found": "match", "told": "progress", "came": "received"})
    assert sorted(faults) == [
        "src/a.py:1: '_found' is retired as a name; write: match",
        "src/a.py:1: 'told' is retired as a name; write: progress",
        "src/a.py:3: 'came' is retired as a name; write: received",
    ]
