"""Run every benchmark briefly, as many at a time as there are cores: whether they work, not how fast.

Each line says how long one took. What went wrong is printed at the end, each output from its last lines backwards: the
fault stands there.

    python tools/run_benchmarks.py [FILE ...]
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
_LAST: Final = 12
"""Lines of an output that are printed first."""
_MOST: Final = 200
"""Lines of an output that are printed at all."""


class Ended(NamedTuple):
    """How a benchmark ended.

    Attributes:
        file: Of the benchmark.
        status: Exit status.
        seconds: Wall time, s.
        output: Standard output and standard error.
    """

    file: Path
    status: int
    seconds: float
    output: str


def run(file: Path) -> Ended:
    """Run one with ``--quick``."""
    begin = time.perf_counter()
    ended = subprocess.run(
        [sys.executable, str(file), "--quick"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    return Ended(file, ended.returncode, time.perf_counter() - begin, ended.stdout.decode(errors="replace"))


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
    failed = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for ended in pool.map(run, chosen):
            print(f"  {'FAILED' if ended.status else 'ok'} {ended.seconds:6.1f} s  {ended.file.name}", flush=True)
            if ended.status:
                failed.append(ended)
    for ended in failed:
        print(f"\n{failure(ended)}")
    print(f"benchmarks: {len(chosen)} run, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
