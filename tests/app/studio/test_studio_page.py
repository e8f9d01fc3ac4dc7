"""The studio in a real browser: from an empty folder to programs for three controllers and their reports."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import studio_walk
from browser import Browser, Page, chromium
from counterflex.app import examples
from counterflex.files.cell.cell import read_cell

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer")
SCAN = Path(__file__).resolve().parents[3] / "examples" / "scans" / "groove.ply"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium; each test has a page of its own."""
    with Browser() as made:
        yield made


def nothing(_: str) -> None:
    """Take no picture."""


def opened(browser: Browser, link: str, *, width: int = 1280) -> Page:
    page = browser.page()
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=width < 500)
    page.open(link)
    return page


def require_programs(folder: Path) -> None:
    """A program in each language, with its report, and the command of each in the list of the project."""
    done = (folder / "studio-commands.txt").read_text(encoding="utf-8").splitlines()
    for language, name in studio_walk.LANGUAGES.items():
        assert (folder / f"groove-{language}" / name).stat().st_size > 0
        line = f"counterflex compensate groove.ngc --cell cell-small.toml --out groove-{language} --as {language}"
        assert f"{line}  # exit 0" in done


def test_from_an_empty_folder_to_three_programs_and_a_report(tmp_path: Path, browser: Browser) -> None:
    folder = tmp_path / "my part"
    with studio_walk.studio(folder) as link:
        page = opened(browser, link)
        studio_walk.cell(page, nothing)
        assert page.value("location.href").endswith("/")  # the secret is in the cookie alone
        studio_walk.program(page, nothing)
        studio_walk.plan(page, nothing)
        require_programs(folder)
        studio_walk.choices(page, nothing)
        assert page.value("document.documentElement.scrollWidth") <= 1280
        assert "groove" in studio_walk.report(page, link)
        assert page.value("self.origin") == "null"  # a page of the folder has no rights in the studio


@pytest.mark.long
def test_readings_of_an_instrument_become_a_cell_file(tmp_path: Path, browser: Browser) -> None:
    examples.write_all(tmp_path / "cell.toml")
    with studio_walk.studio(tmp_path) as link:
        page = opened(browser, link)
        studio_walk.measure(page, nothing, tmp_path)
        assert page.value("document.documentElement.scrollWidth") <= 1280
    assert read_cell(tmp_path / "tracker-frame-identified" / "cell.toml").tables.identified


@pytest.mark.long
@pytest.mark.parametrize("width", [390, 1280, 2560])
def test_proof_inspection_and_the_next_part(tmp_path: Path, browser: Browser, width: int) -> None:
    with studio_walk.studio(tmp_path) as link:
        page = opened(browser, link, width=width)
        studio_walk.cell(page, nothing)
        studio_walk.plan(page, nothing)
        studio_walk.after_the_cut(page, nothing, SCAN)
        assert page.value("document.documentElement.scrollWidth") <= width
        assert (tmp_path / "groove-krl-next" / "groove.src").stat().st_size > 0


@pytest.mark.long
def test_a_stranger_gets_nothing(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("secret", encoding="utf-8")
    with studio_walk.studio(tmp_path) as link:
        base, _, key = link.partition("?")
        closed = "Open the link that counterflex studio has printed"
        assert closed in studio_walk.answer(base)
        assert closed in studio_walk.answer(f"{base}files/secret.txt")
        assert studio_walk.answer(f"{base}?{key}", Host="evil.example") == "403"
        assert studio_walk.answer(f"{base}files/secret.txt", key=link) == "secret"
        for outside in (
            "..%2f" + tmp_path.name + "%2f..%2f..%2fetc/passwd",
            "%2fetc%2fpasswd",
            "../../../../etc/passwd",
        ):
            assert studio_walk.answer(f"{base}files/{outside}", key=link) == "404"
