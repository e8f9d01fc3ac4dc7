"""Names of users' files are text: no sequence steers the terminal, no markup is read, in tables, errors and pages."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from counterflex.cli.output import print_table, progress_bar
from counterflex.cli.printed import everything_is_text
from counterflex.core.printable import printable

ESCAPES = "cell\x1b]0;TITLE\x07\x1b[2J\x1b[31mRED\x9b32m\u202egnp.exe"
MARKUP = "KR 300 [/3] [bold]b[/bold] [link=http://x]l[/link] :smile: <script>alert(1)</script> <b>b</b>"
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def _name(folder: Path, name: str) -> None:
    text = (folder / "cell.toml").read_text(encoding="utf-8")
    shown = "".join(f"\\u{ord(c):04x}" if STEERS.match(c) else c for c in name)
    named = re.sub(r"(?m)^name = .*$", lambda _: f'name = "{shown}"', text, count=1)
    assert named != text
    (folder / "cell.toml").write_text(named, encoding="utf-8")


@pytest.mark.parametrize("name", [ESCAPES, MARKUP], ids=["escapes", "markup"])
@pytest.mark.parametrize(
    "words",
    [
        ("cell", "check", "cell.toml"),
        ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out"),
        ("preflight", "part.ngc", "--cell", "cell.toml"),
    ],
    ids=" ".join,
)
def test_a_name_is_printed_as_text(folder: Path, counterflex: Any, name: str, words: tuple[str, ...]) -> None:
    _name(folder, name)
    ended = counterflex(*words)
    printed = ended.out + ended.err
    assert ended.status in (0, 1), printed
    assert not STEERS.search(printed)
    told = re.sub(r"\s", "", printed)
    if words[0] != "preflight":
        assert re.sub(r"\s", "", printable(name)) in told
    for page in folder.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert "<script>alert" not in text
        shown = re.sub(r"(?s)<script.*?</script>", "", text)  # the library that draws, and JSON, which escapes
        assert not STEERS.search(shown)
        assert "<b>b</b>" not in shown


def test_a_name_in_an_error_is_text(folder: Path, refused: Any) -> None:
    (folder / "part.ngc").write_text("G21\nM6 T1\nG1 Q\x1b[31mX72 F1500\nM30\n", encoding="utf-8")
    line = refused("path", "part.ngc")
    assert not STEERS.search(line)
    line = refused("path", "no\x1b[2Jfile.ngc")
    assert "no\\x1b[2Jfile.ngc" in line


def test_comments_of_a_program_are_text(folder: Path, counterflex: Any) -> None:
    head = "(title \x1b]0;PWN\x07 \x1b[2J)\n"
    text = (folder / "part.ngc").read_text(encoding="utf-8")
    (folder / "part.ngc").write_text(head + text, encoding="utf-8")
    for words in (("path", "part.ngc"), ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out")):
        ended = counterflex(*words)
        assert not STEERS.search(ended.out + ended.err)


def test_tables_read_no_markup_and_no_emoji(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(MARKUP, ["[red]name", "mm"], [[MARKUP, "1"], [ESCAPES, "2"]], note=MARKUP + ESCAPES)
    told = re.sub(r"\s", "", capsys.readouterr().out)
    assert told.count(re.sub(r"\s", "", MARKUP)) == 3
    assert "[red]name" in told
    assert told.count(re.sub(r"\s", "", printable(ESCAPES))) == 2


def test_a_progress_bar_shows_names_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with everything_is_text(), progress_bar(f"{MARKUP}\x1b]0;TITLE\x07") as progress:
        progress(0.5, f"{MARKUP}\x1b]0;TITLE\x07")
        print("\x1b]0;TITLE\x07", file=sys.stderr)
    assert "\x1b]0;" not in screen.getvalue()
    assert "[bold]b[/bold]" in screen.getvalue()
    assert "\\x1b]0;" in screen.getvalue()


def test_what_is_shown_is_what_it_was() -> None:
    assert printable("Fräsen\t10 µm\n") == "Fräsen\t10 µm\n"
    assert printable("a\x1b[2J\x9b\u202e\ud800") == "a\\x1b[2J\\x9b\\u202e\\ud800"
