"""Benchmarks that fail are named, with the end of what they printed first."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
_OPTION = re.compile(r"add_argument\(\s*\"(--[a-z-]+)\"(?:(?!add_argument).)*?(SUPPRESS|$)", re.MULTILINE)


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    file = ROOT / "tools" / "run_benchmarks.py"
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_fault_is_printed_before_what_came_before_it(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tool.loaded_commands, "context", lambda **_: None)  # as where there are no forks
    good, bad = tmp_path / "good.py", tmp_path / "bad.py"
    good.write_text("import sys; print(sys.argv[1:]); assert sys.argv[1:] == ['--quick']", encoding="utf-8")
    bad.write_text("for k in range(40): print('row', k)\nraise ValueError('the reason')", encoding="utf-8")
    assert tool.main([str(bad), str(good)]) == 1
    out = capsys.readouterr().out
    assert [line.split()[0] for line in out.splitlines()[:2]] == ["FAILED", "ok"]
    assert out.index("FAILED bad.py: exit 1") < out.index("ValueError: the reason") < out.index("row 0\n")
    assert "row 39" in out
    assert "['--quick']" not in out  # of one that works only the time
    assert out.splitlines()[-1] == "benchmarks: 2 run, 1 failed"
    assert tool.main([str(good)]) == 0


def test_one_that_prints_nothing_is_named_too(tool: ModuleType, tmp_path: Path) -> None:
    ended = tool.Ended(tmp_path / "silent.py", -9, 1.0, "")
    assert tool.failure(ended).splitlines() == ["FAILED silent.py: exit -9. Its last lines:", "no output"]


def test_every_option_of_every_benchmark_is_in_a_brief_run(tool: ModuleType) -> None:
    for file in sorted((ROOT / "benchmarks").glob("*.py")):
        text = file.read_text(encoding="utf-8")
        options = {name for name, hidden in _OPTION.findall(text) if not hidden}
        used = {word for words in tool.benchmark_options.runs_of(file.stem) for word in words if word.startswith("--")}
        assert used | {"--quick"} == options | {"--quick"}, file.name
        assert text.count("add_argument(") == len(_OPTION.findall(text)), f"{file.name}: an option without its name"
