"""Pictures of the pages that explain are what the program writes, and each stands on a page."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"
NAMES = sorted(file.name for file in IMAGES.glob("theory-*.svg"))


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_figures", ROOT / "tools" / "make_figures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_figures"] = module  # its dataclasses look it up
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules["make_figures"]
    return module


def test_all_pictures_are_there(figures: ModuleType) -> None:
    assert sorted(figures.FIGURES) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_is_what_the_program_writes(figures: ModuleType, name: str) -> None:
    text = (IMAGES / name).read_text(encoding="utf-8")
    assert figures.made(name) == text
    ElementTree.fromstring(text)


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_stands_on_a_page_with_words_for_who_does_not_see_it(name: str) -> None:
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    words = [found for text in pages for found in re.findall(rf"!\[([^\]]+)\]\([^)]*{re.escape(name)}\)", text)]
    assert words
    assert all(len(alternative) > 30 for alternative in words)
