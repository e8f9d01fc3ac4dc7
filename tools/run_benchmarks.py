"""Run every benchmark briefly, as many at a time as there are cores: whether they work, not how fast.

They run in processes that have the libraries loaded already (:mod:`loaded_commands`). Each line says how long one
took. What went wrong is printed at the end, each output from its last lines backwards: the fault stands there.

    python tools/run_benchmarks.py [FILE ...]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
import loaded_commands

ROOT: Final = Path(__file__).resolve().parents[1]
_LAST: Final = 12
"""Lines of an output that are printed first."""
_MOST: Final = 200
"""Lines of an output that are printed at all."""
_MOST_S: Final = 900.0


class Ended(NamedTuple):
    """How a benchmark ended.

    Attributes:
        file: Of the benchmark.
        status: Exit status, or what became of it.
        seconds: Wall time, s.
        output: Standard output and standard error.
    """

    file: Path
    status: int | str
    seconds: float
    output: str


def run(file: Path, forks: Any = None) -> Ended:
    """Run one with ``--quick``.

    Args:
        file: Of the benchmark.
        forks: Where processes come from (:func:`loaded_commands.context`); None: a new one.
    """
    begin = time.perf_counter()
    status: int | str
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        output.touch()
        if forks is not None:
            words = [str(file), "--quick"]
            status = loaded_commands.ended(forks, words, ROOT, dict(os.environ), output, _MOST_S)
        else:
            with output.open("w") as stream:
                words = [sys.executable, str(file), "--quick"]
                status = subprocess.run(words, cwd=ROOT, stdout=stream, stderr=stream, check=False).returncode
        text = output.read_text(encoding="utf-8", errors="replace")
    return Ended(file, status, time.perf_counter() - begin, text)


def failure(ended: Ended) -> str:
    """What to print of one that failed: its last lines, then all of it."""
    lines = ended.output.splitlines() or ["no output"]
    text = [f"FAILED {ended.file.name}: exit {ended.status}. Its last lines:", *lines[-_LAST:]]
    if len(lines) > _LAST:
        text += [f"-- all of {ended.file.name}, {len(lines)} lines:", *lines[-_MOST:]]
    return "\n".join(text)


def main(files: list[str]) -> int:
    """Run the given benchmarks, or all."""
    chosen = [Path(file).resolve() for file in files] or sorted((ROOT / "benchmarks").glob("*.py"))
    forks, failed = loaded_commands.context(many=not files), []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for ended in pool.map(partial(run, forks=forks), chosen):
            print(f"  {'FAILED' if ended.status else 'ok'} {ended.seconds:6.1f} s  {ended.file.name}", flush=True)
            if ended.status:
                failed.append(ended)
    for ended in failed:
        print(f"\n{failure(ended)}")
    print(f"benchmarks: {len(chosen)} run, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
