"""Run every benchmark briefly with all its options, as many at a time as there are cores: whether they work.

The options stand in :mod:`benchmark_options`. They run in processes that have the libraries loaded already
(:mod:`loaded_commands`). Each line says how long one took. What went wrong is printed at the end, each output from its
last lines backwards: the fault stands there.

    python tools/run_benchmarks.py [--turn | FILE ...]

With ``--turn`` only those of the third of this commit (:mod:`thirds`).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
import benchmark_options
import loaded_commands
import thirds

ROOT: Final = Path(__file__).resolve().parents[1]
_LAST: Final = 12
"""Lines of an output that are printed first."""
_MOST: Final = 200
"""Lines of an output that are printed at all."""
_MOST_S: Final = 900.0
_FEW: Final = 4
"""So many benchmarks are not worth reading all compiled kernels for."""


class Ended(NamedTuple):
    """End of a benchmark's run."""

    file: Path  # of the benchmark
    status: int | str  # exit status, or what became of it
    seconds: float  # wall time, s
    output: str  # standard output and standard error
    words: tuple[str, ...] = benchmark_options.BRIEF  # options


def run(job: tuple[Path, tuple[str, ...]], forks: Any = None) -> Ended:
    """Run one briefly.

    Args:
        job: File of the benchmark, and its options.
        forks: Where processes come from (:func:`loaded_commands.context`); None: a new one.
    """
    file, options = job
    begin = time.perf_counter()
    status: int | str
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        output.touch()
        place = _copied(file, Path(folder)) if benchmark_options.STORES in options else file
        chosen = [word.replace(benchmark_options.FOLDER, folder) for word in options]
        if forks is not None:
            words = [str(place), *chosen]
            status = loaded_commands.ended(forks, words, ROOT, dict(os.environ), output, _MOST_S)
        else:
            with output.open("w") as stream:
                words = [sys.executable, str(place), *chosen]
                status = subprocess.run(words, cwd=ROOT, stdout=stream, stderr=stream, check=False).returncode
        text = output.read_text(encoding="utf-8", errors="replace")
    return Ended(file, status, time.perf_counter() - begin, text, options)


def _copied(file: Path, folder: Path) -> Path:
    """The benchmark in a copy of what it reads and writes."""
    for name in ("benchmarks", "docs", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("_build", "__pycache__", "images"))
    return folder / "benchmarks" / file.name


def _named(ended: Ended) -> str:
    """File and options, where they are others than usual."""
    return " ".join([ended.file.name, *(ended.words if ended.words != benchmark_options.BRIEF else ())])


def failure(ended: Ended) -> str:
    """Text to print of one that failed: its last lines, then all of it."""
    lines = ended.output.splitlines() or ["no output"]
    text = [f"FAILED {_named(ended)}: exit {ended.status}. Its last lines:", *lines[-_LAST:]]
    if len(lines) > _LAST:
        text += [f"-- all of {_named(ended)}, {len(lines)} lines:", *lines[-_MOST:]]
    return "\n".join(text)


def every() -> list[Path]:
    """All benchmarks."""
    return sorted((ROOT / "benchmarks").glob("*.py"))


def of_turn(now: thirds.Turn) -> list[Path]:
    """Benchmarks of a turn."""
    return [file for file in every() if now.takes(file.relative_to(ROOT).as_posix())]


def main(files: list[str]) -> int:
    """Run the given benchmarks, those of this commit's third, or all."""
    named = of_turn(thirds.turn()) if files == ["--turn"] else [Path(file).resolve() for file in files] or every()
    chosen = [(file, words) for file in named for words in benchmark_options.runs_of(file.stem)]
    forks, failed = loaded_commands.context(many=len(named) > _FEW), []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for ended in pool.map(partial(run, forks=forks), chosen):
            print(f"  {'FAILED' if ended.status else 'ok'} {ended.seconds:6.1f} s  {_named(ended)}", flush=True)
            if ended.status:
                failed.append(ended)
    for ended in failed:
        print(f"\n{failure(ended)}")
    print(f"benchmarks: {len(chosen)} run, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
