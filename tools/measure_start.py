"""Measure a command's first start and a later one: importing, compiling kernels, computing.

Each command runs twice, with an empty kernel cache and with the one that the first run has filled. Times are those of
the processor, of all processes of the command together, so that other work on the computer changes them little; the
last column is what a clock on the wall shows.

    python tools/measure_start.py [--only pose,compensate] [--costliest 10] [--install]

``--install`` times the installation into an empty virtual environment too; it needs a package index.
"""

from __future__ import annotations

import argparse
import atexit
import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
ROBOT: Final = "kuka_kr300_r2500_ultra"
COMMANDS: Final = {
    "--help": ["--help"],
    "--version": ["--version"],
    "pose": ["pose", ROBOT, "--joints-deg", "0,-90,90,0,0,0"],
    "deflection": ["deflection", "CELL", "--joints-deg", "0,-95,125,0,-30,0", "--force-n", "0,500,0"],
    "cell check": ["cell", "check", "CELL"],
    "compensate": ["compensate", "GROOVE", "--cell", "CELL", "--out", "OUT"],
    "demo": ["demo", "--out", "OUT"],
}


class Stopwatch:
    """Processor time of this process by what it is spent on: what happens within something else counts there only.

    Args:
        out: Folder in which a file of this process is written at its end.
    """

    def __init__(self, out: Path) -> None:
        self._out, self._begin = out, time.process_time()
        self._within: list[float] = []
        self._thread = threading.get_ident()
        self.spent: Counter[str] = Counter()
        self.kernels: list[tuple[str, float]] = []

    @contextmanager
    def on(self, what: str, kernel: str = "") -> Iterator[None]:
        """Count the time of a block as spent on something."""
        self.begin()
        try:
            yield
        finally:
            self.end(what, kernel)

    def begin(self) -> None:
        """Something begins."""
        if threading.get_ident() == self._thread:
            self._within += [time.process_time(), 0.0]

    def end(self, what: str, kernel: str = "") -> None:
        """End what began last."""
        if threading.get_ident() != self._thread:
            return
        inner, begin = self._within.pop(), self._within.pop()
        whole = time.process_time() - begin
        self.spent[what] += whole - inner  # type: ignore[assignment]
        if self._within:
            self._within[-1] += whole
        if kernel:
            self.kernels.append((kernel, whole - inner))

    def write(self) -> None:
        """Write what was counted."""
        total = time.process_time()
        text = json.dumps({"total": total, "spent": self.spent, "kernels": self.kernels})
        (self._out / f"{os.getpid()}.json").write_text(text, encoding="utf-8")


def listen(out: str) -> None:
    """Count the times of this process from now on; called when the interpreter starts."""
    watch = Stopwatch(Path(out))
    bootstrap: Any = vars(importlib)["_bootstrap"]
    genuine = bootstrap._find_and_load

    def load(name: str, import_: Any) -> Any:
        with watch.on("importing"):
            module = genuine(name, import_)
        if name == "numba.core.registry":
            _listen_to_numba(watch)
        return module

    bootstrap._find_and_load = load
    atexit.register(watch.write)


def _listen_to_numba(watch: Stopwatch) -> None:
    from numba.core import caching, event

    class Heard(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            del event
            watch.begin()

        def on_end(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            watch.end("compiling", f"{function.__module__}.{function.__qualname__}")

    event.register("numba:compile", Heard())
    genuine = caching.Cache.load_overload

    def load(self: Any, signature: Any, context: Any) -> Any:
        with watch.on("reading"):
            return genuine(self, signature, context)

    caching.Cache.load_overload = load


def run(words: list[str], cache: Path) -> dict[str, Any]:
    """Run a command and give its times, s, and the compiled kernels with theirs."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        (out / "sitecustomize.py").write_text(
            f"import sys\nsys.path.insert(0, {str(ROOT / 'tools')!r})\nimport measure_start\n"
            f"sys.path.pop(0)\nmeasure_start.listen({name!r})\n"
        )
        path = os.pathsep.join([name, str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
        given = os.environ | {"PYTHONPATH": path, "COUNTERFLEX_CACHE": str(cache), "COUNTERFLEX_PROGRESS_S": "0"}
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        ended = subprocess.run(
            [sys.executable, "-m", "counterflex", *words], env=given, capture_output=True, text=True, check=False
        )
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        if ended.returncode:
            raise SystemExit(f"counterflex {' '.join(words)}: {ended.stderr}")
        seen = [json.loads(file.read_text(encoding="utf-8")) for file in out.glob("*.json")]
    spent: Counter[str] = Counter()
    for one in seen:
        spent.update(one["spent"])
    total = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    kernels = [(kernel, seconds) for one in seen for kernel, seconds in one["kernels"]]
    return {**spent, "computing": total - sum(spent.values()), "total": total, "wall": wall, "kernels": kernels}


def _print_costliest(kernels: list[tuple[str, float]], count: int) -> None:
    seconds: Counter[str] = Counter()
    times = Counter(name for name, _ in kernels)
    for name, spent in kernels:
        seconds[name] += spent  # type: ignore[assignment]
    print(f"  {len(kernels)} compilations of {len(times)} functions, the costliest:")
    for name, spent in seconds.most_common(count):
        print(f"  {spent:6.2f} s  {times[name]} x  {name.removeprefix('counterflex.')}")


def _install(folder: Path) -> None:
    begin = time.perf_counter()
    venv = folder / "venv"
    subprocess.run(["make", "-s", f"VENV={venv}", f"{venv}/.installed-run"], cwd=ROOT, check=True)
    print(f"installing: {time.perf_counter() - begin:.0f} s\n")


def main() -> None:
    """Measure the commands and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(COMMANDS), help="commands, with commas between them")
    parser.add_argument("--costliest", type=int, default=10, help="how many kernels are listed")
    parser.add_argument("--install", action="store_true", help="time the installation too")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if chosen.install:
            _install(folder)
        run(["cell", "example", "--out", str(folder / "cell.toml")], folder / "unused")
        places = {"CELL": folder / "cell-small.toml", "GROOVE": folder / "groove.ngc"}
        titles = ("importing", "compiling", "reading", "computing", "total", "wall")
        print("| command | cache | " + " | ".join(f"{title} s" for title in titles) + " |")
        print("|---|---|" + "--:|" * len(titles))
        compiled: dict[str, list[tuple[str, float]]] = {}
        for command in chosen.only.split(","):
            cache = folder / f"cache{command}"
            for k, state in enumerate(("empty", "filled")):
                known = {**places, "OUT": folder / f"out{command}{k}"}
                times = run([str(known.get(word, word)) for word in COMMANDS[command]], cache)
                row = " | ".join(f"{times.get(title, 0.0):.2f}" for title in titles)
                print(f"| `{command}` | {state} | {row} |", flush=True)
                compiled[command] = compiled.get(command) or times["kernels"]
        for command, kernels in compiled.items():
            if kernels:
                print(f"\n{command}")
                _print_costliest(kernels, chosen.costliest)


if __name__ == "__main__":
    main()
