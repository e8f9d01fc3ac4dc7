"""Suggested commands are taken apart by the shell into what they were made of; outputs go where no input lies."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.core.next_command import next_command

texts = st.text(min_size=1, max_size=12).filter(lambda text: "\0" not in text)
names = st.from_regex(r"[a-z]{1,6}(_[a-z]{1,5})?", fullmatch=True).filter(lambda name: name != "out")
options = st.dictionaries(
    names, texts | st.integers() | st.booleans() | st.none() | st.lists(texts | st.integers(), max_size=3), max_size=4
)


@settings(max_examples=40)
@example(["-", "-x.ngc"], {})
@given(st.lists(texts | st.none(), max_size=3), options)
def test_a_shell_reads_back_what_was_given(values: list[str | None], given_: dict[str, Any]) -> None:
    """Arguments in their order, then options by name: flags alone, lists repeated, what is None or False left out.

    A file whose name begins with a dash is named from its folder, or the command would take it for an option.
    """
    files = [f"./{value}" if value[0] == "-" else value for value in values if value is not None]
    expected = ["counterflex", "log", "show", *files]
    for name, value in given_.items():
        for one in value if isinstance(value, list) else [value]:
            if one is True:
                expected.append(f"--{name.replace('_', '-')}")
            elif one is not None and one is not False:
                expected += [f"--{name.replace('_', '-')}", str(one)]
    assert shlex.split(next_command("log show", *values, **given_)) == expected


@pytest.mark.parametrize("file", ["out/part.ngc", "./out/part.ngc", "x/../out/part.ngc", "{here}/out/part.ngc"])
@pytest.mark.parametrize("as_option", [True, False])
def test_a_folder_that_is_read_is_not_written_whatever_its_name(
    file: str, as_option: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It gets the next free number; one that is free keeps its name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").mkdir()
    name = file.format(here=tmp_path)
    for out, written in (("out", "out-2"), ("./out", "./out-2"), ("other", "other")):
        given_: dict[str, Any] = {"cell": name, "out": out} if as_option else {"out": out}
        words = shlex.split(next_command("prove", *([] if as_option else [name]), **given_))
        assert words[words.index("--out") + 1] == written
    both = shlex.split(next_command("prove", name, cell=str(tmp_path / "out-2" / "cell.toml"), out="out"))
    assert both[-1] == "out-3"
