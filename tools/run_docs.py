"""Run every command printed in the docs and every example, as a reader would, and fail when one fails.

Commands are the lines that begin with ``$ `` in fenced ``console`` blocks of README.md, CONTRIBUTING.md and docs/. The
commands of one page run in order in one fresh folder that holds a copy of ``examples/``, several pages at a time. A
command that is meant to fail says so: ``$ counterflex pose nowhere  # exit 2``. Examples are ``examples/*.py``.

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
from concurrent.futures import ThreadPoolExecutor
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


def run(command: str, wanted: int, folder: Path) -> tuple[bool, str]:
    """Run one command in a folder: whether it ended as wanted, and what to print: time, and else its output."""
    begin = time.perf_counter()
    environment = dict(os.environ, PATH=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    result = subprocess.run(
        shlex.split(command), cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    ok = result.returncode == wanted
    said = f"  {'ok' if ok else 'FAILED'} {time.perf_counter() - begin:6.1f} s  {command}"
    if not ok:
        said += f"\nexit {result.returncode}, wanted {wanted}\n{result.stdout[-3000:]}\n{result.stderr[-3000:]}"
    return ok, said


def run_page(page: Path) -> tuple[int, int, str]:
    """Run the commands of a page, or an example: how many, how many failed, what to print."""
    named = str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else str(page)
    script = f"{shlex.quote(sys.executable)} {shlex.quote(str(page))}"
    found = [(script, 0)] if page.suffix == ".py" else commands(page)
    lines, faults = [named], 0
    with tempfile.TemporaryDirectory() as folder:
        if found and page.suffix != ".py":
            shutil.copytree(ROOT / "examples", Path(folder) / "examples")
        for command, wanted in found:
            ok, said = run(command, wanted, Path(folder))
            faults += not ok
            lines.append(said)
    return len(found), faults, "\n".join(lines)


def main(pages: list[str]) -> int:
    """Run the given pages, or all pages and all examples, as many at a time as there are cores."""
    chosen = [Path(page).resolve() for page in pages] or [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        *sorted((ROOT / "examples").glob("*.py")),
    ]
    count, faults = 0, 0
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for many, failed, said in pool.map(run_page, chosen):
            count, faults = count + many, faults + failed
            if many:
                print(said, flush=True)
    print(f"documented commands and examples: {count} run, {faults} failed")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
