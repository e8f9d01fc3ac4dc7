"""Links between the documents: every file is there, and every place in it; every page can be reached from the index."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from pathlib import Path

import pytest

from docs_site.rooms import chosen, fields

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")), *(ROOT / "docs").rglob("*.md")]
PAGES = [page for page in PAGES if "_build" not in page.parts]
_CODE = re.compile(r"^[ \t]*```.*?^[ \t]*```|`[^`\n]*`", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^(#{1,6}) (.+?)\s*#*$", re.MULTILINE)
_TARGET = re.compile(r"^\((\S+)\)=$", re.MULTILINE)
_ENTRY = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)


def _prose(page: Path) -> str:
    """Text of a page without its code blocks."""
    return re.sub(r"^[ \t]*```.*?^[ \t]*```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def _slug(heading: str) -> str:
    """Anchor of a heading, as GitHub and MyST make it."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").replace("*", "")
    kept = (c for c in unicodedata.normalize("NFC", plain.lower()) if c.isalnum() or c in " -_")
    return "".join(kept).strip().replace(" ", "-")


def anchors(page: Path) -> set[str]:
    """Anchors of a page, those that it names itself too; a heading that repeats gets a number."""
    found = set(_TARGET.findall(_prose(page)))
    for _, heading in _HEADING.findall(_prose(page)):
        slug, number = _slug(heading), 0
        while (name := slug if number == 0 else f"{slug}-{number}") in found:
            number += 1
        found.add(name)
    return found


def links(page: Path) -> list[str]:
    """Internal links of a page."""
    text = _CODE.sub("", page.read_text(encoding="utf-8"))
    return [link for link in _LINK.findall(text) if not re.match(r"[a-z]+:", link)]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_every_link_has_its_file_and_its_place(page: Path) -> None:
    missing = []
    for link in links(page):
        name, _, anchor = link.partition("#")
        target = page if not name else (page.parent / name).resolve()
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            missing.append(link)
    assert missing == []


def test_every_page_of_the_documentation_can_be_reached_from_its_index() -> None:
    docs, todo, seen = ROOT / "docs", [ROOT / "docs" / "index.md"], set()
    while todo:
        page = todo.pop()
        if page in seen or not page.exists():
            continue
        seen.add(page)
        text = page.read_text(encoding="utf-8")
        listed = [line.strip() for block in _ENTRY.findall(text) for line in block.splitlines()]
        todo += [page.parent / f"{name}.md" for name in listed if name and not name.startswith(":")]
        todo += [(page.parent / link.partition("#")[0]).resolve() for link in links(page) if ".md" in link]
    assert [
        str(page.relative_to(docs)) for page in (docs).rglob("*.md") if "_build" not in page.parts and page not in seen
    ] == []


def test_a_link_that_leads_nowhere_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A `b` (c), *d*\n\n## x_y\n\n## x_y\n\n[one](other.md#place) `[no](code.md)` [two](#x_y-1)\n")
    assert anchors(page) == {"a-b-c-d", "x_y", "x_y-1"}
    assert links(page) == ["other.md#place", "#x_y-1"]


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "reference").glob("*.rst")), ids=lambda page: page.stem)
def test_a_reference_page_names_modules_that_exist(page: Path) -> None:
    for package, only in re.findall(
        r"^\.\. room:: (\S+)\n(?:   :only: (.+)\n)?", page.read_text("utf-8"), re.MULTILINE
    ):
        assert chosen(package, only.split())


def test_the_reference_says_of_a_field_what_its_comment_says() -> None:
    source = '''
    class Cut:
        """What a cut gives."""

        volume_m3: Float  # (n,) removed
        # (n, 6) N, N m, mean wrench on the tool
        # about its tip
        w: Float = 1  # part axes
        plain: int
        _own: int  # hidden
    '''
    expected = [("volume_m3", "(n,) removed"), ("w", "(n, 6) N, N m, mean wrench on the tool about its tip part axes")]
    assert fields(textwrap.dedent(source).lstrip()) == expected
