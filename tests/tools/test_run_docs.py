"""Documented commands are found wherever they stand, with the exit status they should end with."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

PAGE = """
Text with `$ not this`.

```console
$ counterflex robots
its output
$ counterflex pose nowhere  # exit 2
```

1. In a list:

   ```console
   $ counterflex pose a \\
     --joints-deg 0,0
   ```

```sh
$ not this either
```
"""


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("run_docs", Path(__file__).parents[2] / "tools" / "run_docs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_commands_and_their_exit_status(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    found = [(" ".join(command.split()), wanted) for command, wanted in _load().commands(page)]
    assert found == [
        ("counterflex robots", 0),
        ("counterflex pose nowhere", 2),
        ("counterflex pose a --joints-deg 0,0", 0),
    ]


def test_a_command_that_ends_otherwise_fails(tmp_path: Path) -> None:
    tool = _load()
    assert tool.run("python -c 'raise SystemExit(2)'", 2, tmp_path)[0]
    ended, said = tool.run("python -c 'print(1); raise SystemExit(1)'", 0, tmp_path)
    assert not ended
    assert "exit 1, wanted 0" in said


def test_a_page_counts_its_faults(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ python -c pass\n$ python -c pass  # exit 1\n```\n", encoding="utf-8")
    count, faults, said = _load().run_page(page)
    assert (count, faults) == (2, 1)
    assert said.index("ok") < said.index("FAILED")
