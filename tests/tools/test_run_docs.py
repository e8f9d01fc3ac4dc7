"""Documented commands are found wherever they stand, and run as they say: exit status, terminals, quick forms."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

PAGE = """
Text with `$ not this`.

```console
$ counterflex robots
its output
$ counterflex pose nowhere  # exit 2
$ counterflex soak --minutes 60 --out soak  # quick: --minutes 0.1
$ counterflex doctor  # exit 0 or 1
```

1. In a list:

   ```console
   $ counterflex pose a \\
     --joints-deg 0,0
   1$ counterflex run --out log
   2$ counterflex twin cell
   2$ counterflex log show log
   3$ counterflex twin netft  # Ctrl-C
   $ counterflex evaluate part
   ```

<!-- not run: takes an
hour -->
```sh
$ not this either
counterflex reproduce
counterflex soak
```

    counterflex indented
"""


def _load() -> ModuleType:
    name = "run_docs"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).parents[2] / "tools" / "run_docs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its dataclasses look it up
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[name]
    return module


def test_commands_their_terminals_and_how_they_end() -> None:
    page = _load().read_page(PAGE)
    steps = [
        {
            terminal: [(" ".join(c.words.split()), c.exits, c.stopped) for c in commands]
            for terminal, commands in s.items()
        }
        for s in page.steps
    ]
    assert steps == [
        {"": [("counterflex robots", (0,), False)]},
        {"": [("counterflex pose nowhere", (2,), False)]},
        {"": [("counterflex soak --minutes 60 --out soak --minutes 0.1", (0,), False)]},
        {"": [("counterflex doctor", (0, 1), False)]},
        {"": [("counterflex pose a --joints-deg 0,0", (0,), False)]},
        {
            "1": [("counterflex run --out log", (0,), False)],
            "2": [("counterflex twin cell", (0,), False), ("counterflex log show log", (0,), False)],
            "3": [("counterflex twin netft", (0,), True)],
        },
        {"": [("counterflex evaluate part", (0,), False)]},
    ]
    assert dict(page.left_out) == {"takes an hour": 2}
    assert page.unexplained == ["counterflex indented"]


def test_a_command_that_ends_otherwise_fails(tmp_path: Path) -> None:
    tool = _load()
    right, wrong = tool.Command("python -c 'raise SystemExit(2)'", exits=(1, 2)), tool.Command("python -c 1/0")
    assert tool.run_step({"": [right]}, tmp_path)[0] == 0
    faults, said = tool.run_step({"": [wrong]}, tmp_path)
    assert faults == 1
    assert "exit 1, wanted 0" in said[0]
    assert "ZeroDivisionError" in said[0]


def test_what_stands_before_a_bar_is_given_to_what_stands_behind_it(tmp_path: Path) -> None:
    """The status is that of the last command; a bar within quotes is none."""
    tool = _load()
    given = tool.Command("echo 3 | python -c 'import sys; sys.exit(int(sys.stdin.read()) | 0)'", exits=(3,))
    assert tool.run_step({"": [given]}, tmp_path)[0] == 0
    assert tool.run_step({"": [tool.Command("python -c 'raise SystemExit(1 | 2)'", exits=(3,))]}, tmp_path)[0] == 0


SCRIPT = """
import atexit, os, sys, textwrap
atexit.register(print, "left")
begun = sys.modules["__main__"].__file__ == sys.argv[0]
print(__name__, begun, os.getcwd(), sys.argv[1:], getattr(textwrap, "mark", None))
print(os.environ["MARK"], "PYTHONPATH" in os.environ, "numba" in sys.modules, "polars" in sys.modules)
print("to standard error", file=sys.stderr)
textwrap.mark = "of another command"
if sys.argv[1] == "broken":
    raise ValueError("broken")
sys.exit(int(sys.argv[1]))
"""


RUN = """
import os, sys
from pathlib import Path
sys.path.insert(0, sys.argv.pop(1))
import loaded_commands
script, work, outputs = map(Path, sys.argv[1:])
forks = loaded_commands.context()
for word in ("0", "3", "broken"):
    output = outputs / f"output-{word}"
    print(loaded_commands.ended(forks, [str(script), word, "--word"], work, dict(os.environ), output, 60.0))
"""


def test_a_command_with_its_libraries_loaded_ends_as_one_of_a_shell_does(tmp_path: Path) -> None:
    """Its status, words, folder and output are its own, and so is its state.

    All from a process of its own: one that forked before, as another test may have let this one, loads nothing.
    """
    script, work = tmp_path / "script", tmp_path / "work"
    script.write_text(SCRIPT, encoding="utf-8")
    work.mkdir()
    environment = dict(os.environ, MARK="of the page")
    environment.pop("PYTHONPATH", None)
    tools = str(Path(__file__).parents[2] / "tools")
    command = [sys.executable, "-c", RUN, tools, str(script), str(work), str(tmp_path)]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["0", "3", "1"]
    for word in ("0", "3", "broken"):
        lines = (tmp_path / f"output-{word}").read_text(encoding="utf-8").splitlines()
        assert f"__main__ True {work} ['{word}', '--word'] None" in lines
        assert {"of the page False True False", "to standard error", "left"} <= set(lines)
        assert ("ValueError: broken" in lines) == (word == "broken")
        if word == "broken":
            assert lines.index("of the page False True False") < lines.index("ValueError: broken")


def test_terminals_run_at_the_same_time_and_one_is_stopped(tmp_path: Path) -> None:
    waiting = (
        "import socket; s = socket.create_server(('127.0.0.1', 0)); open('part', 'w').write(str(s.getsockname()[1]));"
        " import os; os.replace('part', 'port'); s.accept()[0].recv(1)"
    )
    asking = (
        "import os, socket\nwhile not os.path.exists('port'): pass\n"
        "socket.create_connection(('127.0.0.1', int(open('port').read()))).send(b'x')"
    )
    serving = "import threading; threading.Event().wait()"
    tool = _load()
    step = {
        "1": [tool.Command(f"python -c '{waiting.replace(chr(39), chr(34))}'")],
        "2": [tool.Command(f"python -c '{asking.replace(chr(39), chr(34))}'")],
        "3": [tool.Command(f"python -c '{serving}'", stopped=True, exits=(1, -2))],
    }
    faults, said = tool.run_step(step, tmp_path)
    assert faults == 0, said


def test_a_page_counts_its_faults(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "```console\n$ python -c pass\n$ python -c pass  # exit 1\n```\n\n```\ncounterflex robots\n```\n",
        encoding="utf-8",
    )
    count, faults, left_out, said = _load().run_page(page, tmp_path)
    assert (count, faults, left_out.total()) == (2, 2, 0)
    assert "neither run nor said why: counterflex robots" in said
    assert said.index("ok") < said.index("FAILED ")


def test_every_page_says_of_each_command_whether_it_is_run() -> None:
    tool = _load()
    pages = [tool.ROOT / "README.md", *sorted((tool.ROOT / "docs").rglob("*.md"))]
    found = {page.name: tool.read_page(page.read_text(encoding="utf-8")) for page in pages}
    assert {name: page.unexplained for name, page in found.items() if page.unexplained} == {}
    run = sum(len(commands) for page in found.values() for step in page.steps for commands in step.values())
    left_out = sum(page.left_out.total() for page in found.values())
    assert left_out < run / 4


def test_blocks_of_python_run_in_their_order_or_say_why_not(tmp_path: Path) -> None:
    tool = _load()
    text = (
        "```console\n$ python -c \"open('a', 'w').write('1')\"\n```\n\n"
        "1. In a list:\n\n   ```python\n   for way in ('a',):\n       assert open(way).read() == '1' | '2'\n   ```\n\n"
        "```python\nassert open('a').read() == '1', 'a | b'\n```\n\n"
        "<!-- not run: needs a robot -->\n```python\nimport robot\n```\n"
    )
    page = tool.read_page(text)
    shown = [command.shown for step in page.steps for command in step[""]]
    assert shown == ["", "python block in line 7", "python block in line 12"]
    assert dict(page.left_out) == {"needs a robot": 1}
    file = tmp_path / "page.md"
    file.write_text(text, encoding="utf-8")
    count, faults, _, said = tool.run_page(file, tmp_path)
    assert (count, faults) == (3, 1)
    assert "TypeError" in said  # '1' | '2'
    assert "python block in line 12" in said


def test_every_example_is_run_by_a_page_or_by_itself() -> None:
    tool = _load()
    chosen = tool.all_pages()
    pages = [tool.read_page(path.read_text(encoding="utf-8")) for path in chosen if path.suffix == ".md"]
    words = [c.words for page in pages for step in page.steps for commands in step.values() for c in commands]
    assert len(pages) > 50
    for example in sorted((tool.ROOT / "examples").glob("*.py")):
        assert (f"python examples/{example.name}" in words) != (example in chosen)


def test_a_reason_is_that_of_its_own_block_alone() -> None:
    tool = _load()
    text = (
        "<!-- not run: takes an hour -->\n```\ncounterflex soak\n```\nWords between.\n\n"
        "<!-- not run: needs a robot -->\n```\ncounterflex rsi check\n```\n"
    )
    assert dict(tool.read_page(text).left_out) == {"takes an hour": 1, "needs a robot": 1}


def test_a_page_goes_on_from_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tool = _load()
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    (tmp_path / "examples").mkdir()
    (tmp_path / "tests" / "outside").mkdir(parents=True)
    make, use = "open('made', 'w').write('x')", "assert open('made').read() == 'x'"
    (tmp_path / "README.md").write_text(f'```console\n$ python -c "{make}"\n```\n', encoding="utf-8")
    text = f'<!-- goes on from: README.md -->\n```console\n$ python -c "{use}"\n```\n'
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    assert tool.main([str(tmp_path / "page.md")]) == 0
    assert "2 run, 0 failed" in capsys.readouterr().out


def test_long_commands_are_left_out_only_where_it_is_another_turn() -> None:
    tool = _load()
    text = (
        "```console\n$ counterflex robots\n1$ counterflex reproduce all  # exit 1  # long\n2$ counterflex pose\n```\n"
    )
    page = tool.read_page(text)
    turns = [tool.thirds.Turn(number) for number in range(tool.thirds.COUNT)]
    found = [tool.without_long(page, "docs/page.md", now) for now in turns]
    whole = [one for one in found if one == page]
    assert len(whole) == 1
    for other in (one for one in found if one != page):
        assert [c.words for step in other.steps for them in step.values() for c in them] == [
            "counterflex robots",
            "counterflex pose",
        ]
        assert other.left_out.total() == 1
    assert tool.without_long(page, "docs/page.md", None) == page
    assert tool.without_long(page, "docs/page.md", tool.thirds.Turn(-1, {"docs/page.md"})) == page


def test_each_page_has_its_turn_and_what_readers_begin_with_has_every_turn() -> None:
    tool = _load()
    pages = tool.all_pages()
    turns = [tool.of_the_turn(pages, tool.thirds.Turn(number)) for number in range(tool.thirds.COUNT)]
    assert set().union(*turns) == set(pages)
    assert all(len(turn) < 0.6 * len(pages) for turn in turns)
    for turn in turns:
        assert {tool.ROOT / name for name in tool.ALWAYS} <= set(turn)
        assert all(tool.base_of(page) is None or tool.base_of(page) in turn for page in turn)


def test_a_page_that_changed_is_run_at_once() -> None:
    tool = _load()
    pages, page = tool.all_pages(), tool.ROOT / "docs" / "soak.md"
    other = (tool.thirds.third_of("docs/soak.md") + 1) % tool.thirds.COUNT
    assert page not in tool.of_the_turn(pages, tool.thirds.Turn(other))
    assert page in tool.of_the_turn(pages, tool.thirds.Turn(other, ("docs/soak.md",)))


def test_no_page_holds_a_command_that_is_neither_run_nor_explained() -> None:
    """Also of the pages that a turn leaves out."""
    tool = _load()
    assert [
        w for page in tool.all_pages() if page.suffix == ".md" for w in tool.read_page(page.read_text()).unexplained
    ] == []
