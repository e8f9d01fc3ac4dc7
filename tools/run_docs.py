"""Run every command printed in the docs and every example, as a reader would, and fail when one fails.

Commands are the lines that begin with ``$ `` in fenced ``console`` blocks of README.md, CONTRIBUTING.md and docs/. The
commands of one page run in order in one fresh folder that holds a copy of ``examples/``. A command that is meant to
fail says so: ``$ counterflex pose nowhere  # exit 2``. Examples are the scripts ``examples/*.py``.

    python tools/run_docs.py [PAGE ...]
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_FENCE = re.compile(r"^[ \t]*```console\n(.*?)^[ \t]*```", re.MULTILINE | re.DOTALL)
_EXIT = re.compile(r"\s+# exit (\d+)\s*$")


def commands(page: Path) -> list[tuple[str, int]]:
    """Commands of a page with the exit status each should end with."""
    found = []
    for block in _FENCE.findall(page.read_text(encoding="utf-8")):
        joined = block.replace("\\\n", " ")
        for line in map(str.strip, joined.splitlines()):
            if line.startswith("$ "):
                wanted = _EXIT.search(line)
                found.append((_EXIT.sub("", line[2:]).strip(), int(wanted.group(1)) if wanted else 0))
    return found


def run(command: str, wanted: int, folder: Path) -> bool:
    """Run one command in a folder; print it, its time, and its output when it ends otherwise than wanted."""
    begin = time.perf_counter()
    environment = dict(os.environ, PATH=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    result = subprocess.run(
        shlex.split(command), cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    ok = result.returncode == wanted
    print(f"  {'ok' if ok else 'FAILED'} {time.perf_counter() - begin:6.1f} s  {command}", flush=True)
    if not ok:
        print(f"exit {result.returncode}, wanted {wanted}\n{result.stdout[-3000:]}\n{result.stderr[-3000:]}")
    return ok


def main(pages: list[str]) -> int:
    """Run the given pages, or all pages and all examples."""
    chosen = [Path(page).resolve() for page in pages] or [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "docs").rglob("*.md")),
    ]
    count, faults = 0, 0
    for page in chosen:
        found = commands(page)
        if not found:
            continue
        print(page.relative_to(ROOT))
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(ROOT / "examples", Path(folder) / "examples")
            for command, wanted in found:
                count += 1
                faults += not run(command, wanted, Path(folder))
    if not pages:
        print("examples")
        for script in sorted((ROOT / "examples").glob("*.py")):
            with tempfile.TemporaryDirectory() as folder:
                count += 1
                faults += not run(f"{shlex.quote(sys.executable)} {shlex.quote(str(script))}", 0, Path(folder))
    print(f"documented commands and examples: {count} run, {faults} failed")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
