"""Plant plausible defects one at a time in a scratch copy, and report which of them the tests catch.

    python tools/plant_defects.py                          # the kept set, tools/planted_defects/*.toml
    python tools/plant_defects.py --room evaluate --jobs 2
    python tools/plant_defects.py --per-room 5 --seed 3    # some of the set, all rooms alike
    python tools/plant_defects.py --changed main --random 40 --seed 3
    python tools/plant_defects.py --report                 # score of what has been run, nothing else

Each defect is one exact exchange of text. The test that caught it last (``caught_by.json``, which ``--remember``
writes) is run, then the test files nearest to it, those of its own room first and those of the rooms above, until one
fails. Results are appended to ``out/planted.jsonl`` at once: an interrupted run
continues where it ended, and a defect is run again only when its text, its file or the tests that missed it have
changed. Linux and macOS (a process is forked for each defect, which spares the start of the libraries).
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mutation_operators
from nearest_tests import enclosing_name, nearest_tests

ROOT: Final = Path(__file__).resolve().parents[1]
SET: Final = ROOT / "tools" / "planted_defects"
KINDS: Final = ("figure", "asymmetric", "state", "bound", "sign", "unit", "order", "refusal", "random")
CAUGHT: Final = SET / "caught_by.json"
_LIBRARIES: Final = (
    "numpy",
    "scipy.optimize",
    "scipy.signal",
    "scipy.spatial",
    "numba",
    "polars",
    "pydantic",
    "pytest",
)
_AROUND: Final = 80
"""Characters to both sides of a defect that are part of it."""
_FIRST: Final = 2
"""Test files of the first batch: most defects are caught there, and the others are then never collected."""


def _alike(one: str, other: str) -> int:
    """Number of characters at the beginning that two texts share."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((place for place, (a, b) in pairs if a != b), min(len(one), len(other)))


@dataclass(frozen=True)
class Defect:
    """One defect."""

    name: str  # unique words, what is wrong
    file: str  # source file below the root
    kind: str  # one of KINDS
    before: str  # text of the whole file
    after: str  # the same with the defect
    function: str  # function or class that holds it
    interpreted: bool = False  # run the kernels as plain Python, where that is quicker than to compile them
    tests: tuple[str, ...] = ()  # test files to run first, where imports do not tell which are nearest

    def nearest(self, own: int, above: int) -> tuple[list[str], list[str]]:
        """Return the test files of its own room and of those above that are run for it, in their order."""
        mine, others = nearest_tests(ROOT, self.file, self.function)
        first = list(self.tests)
        return [*first, *(name for name in mine if name not in first)][:own], [
            name for name in others if name not in first
        ][:above]

    @property
    def room(self) -> str:
        """First folder below the package; ``lab`` for what lies there."""
        parts = Path(self.file).parts
        return parts[0] if parts[0] == "lab" else parts[2]

    @property
    def digest(self) -> str:
        """Short hash of file and exchange with the text around it; changes elsewhere in the file leave it."""
        begin = _alike(self.before, self.after)
        end = _alike(self.before[begin:][::-1], self.after[begin:][::-1])
        around = self.before[max(0, begin - _AROUND) : begin], self.before[len(self.before) - end :][:_AROUND]
        text = "\0".join([self.file, *around, self.after[begin : len(self.after) - end]])
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_set(root: Path = ROOT, folder: Path = SET) -> tuple[list[Defect], list[str]]:
    """Read the kept set, and name the entries that fit their source no longer.

    Raises:
        ValueError: A name used twice, an unknown kind, a file of another room, no change.
        SyntaxError: A source that would not compile.
    """
    defects: list[Defect] = []
    stale: list[str] = []
    for path in sorted(folder.glob("*.toml")):
        for row in tomllib.loads(path.read_text(encoding="utf-8"))["defect"]:
            where = f"{path.name}: {row['name']!r}"
            source = root / row["file"]
            before = source.read_text(encoding="utf-8") if source.is_file() else ""
            if before.count(row["old"]) != 1:
                stale.append(f"{where}: old text occurs {before.count(row['old'])} times in {row['file']}")
                continue
            if row["kind"] not in KINDS:
                raise ValueError(f"{where}: kind {row['kind']!r} is none of {', '.join(KINDS)}")
            after = before.replace(row["old"], row["new"])
            compile(after, row["file"], "exec")
            function = enclosing_name(before, before.index(row["old"]))
            defect = Defect(
                row["name"], row["file"], row["kind"], before, after, function, row.get("interpreted", False),
                tuple(row.get("tests", ())),
            )  # fmt: skip
            if path.stem != defect.room or after == before:
                raise ValueError(f"{where}: not of this room, or no change")
            defects.append(defect)
    twice = [name for name, count in Counter(one.name for one in defects).items() if count > 1]
    if twice:
        raise ValueError(f"names used twice: {twice}")
    return defects, stale


def drawn_per_room(defects: list[Defect], count: int, seed: int) -> list[Defect]:
    """Draw some defects of each room by chance, the rooms in turn: an interrupted run has seen all of them alike."""
    rng = random.Random(seed)
    drawn = rng.sample(defects, len(defects))
    place: Counter[str] = Counter()
    turns = []
    for defect in drawn:
        turns.append((place[defect.room], defect.room, defect))
        place[defect.room] += 1
    return [defect for turn, _, defect in sorted(turns, key=lambda one: one[:2]) if turn < count]


def random_defects(since: str | None, rooms: list[str], count: int, seed: int) -> list[Defect]:
    """Draw defects by operator: in lines that differ from a commit, or anywhere in some rooms."""
    if since:
        files: dict[str, set[int] | None] = dict(mutation_operators.changed_lines(ROOT, since))
    else:
        package = ROOT / "src" / "counterflex"
        folders = [package / room for room in rooms] or [package]
        files = {file.relative_to(ROOT).as_posix(): None for folder in folders for file in folder.rglob("*.py")}
    if rooms:
        files = {file: lines for file, lines in files.items() if file.split("/")[2] in rooms}
    defects = []
    for file, change in mutation_operators.sample(ROOT, files, count, seed):
        data = (ROOT / file).read_bytes()
        after = (data[: change.start] + change.new.encode() + data[change.end :]).decode()
        function = enclosing_name(data.decode(), len(data[: change.start].decode()))
        name = f"{Path(file).stem}:{change.line} in {function or 'module'}: {change.words}"
        defects.append(Defect(name, file, "random", data.decode(), after, function))
    return defects


class _Watch:
    """Keep the first failure, and the order of files as they were given."""

    def __init__(self, files: list[str]) -> None:
        self.rank = {name: place for place, name in enumerate(files)}
        self.failed = ""

    def hook(self) -> Any:
        """Return the plugin; pytest is imported in the child only."""
        import pytest

        watch = self

        class Plugin:
            @pytest.hookimpl(tryfirst=True)
            def pytest_collection(self) -> None:
                """A failure is all that is asked for: its smallest example would take minutes to find."""
                from hypothesis import Phase, settings

                settings.register_profile("planted", phases=(Phase.explicit, Phase.generate), parent=settings.default)
                settings.load_profile("planted")

            @pytest.hookimpl(wrapper=True)
            def pytest_collection_modifyitems(self, items: list[Any]) -> Generator[None, None, None]:
                yield
                items.sort(key=lambda item: watch.rank.get(item.nodeid.split("::")[0], 0))

            def pytest_runtest_logreport(self, report: Any) -> None:
                if report.failed and not watch.failed:
                    watch.failed = report.nodeid

            def pytest_collectreport(self, report: Any) -> None:
                if report.failed and not watch.failed:
                    watch.failed = report.nodeid

        return Plugin()


def _run_tests(scratch: Path, last: str, batches: list[list[str]], interpreted: bool) -> str:
    """Run one test and batches of test files in this process until a test fails; its name, "" for none."""
    os.chdir(scratch)
    quiet = os.open(scratch / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    sys.path[:0] = [str(scratch / "src"), str(scratch)]
    sys.dont_write_bytecode = False  # what has not changed is compiled once per scratch copy
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ |= {"PYTHONPATH": str(scratch / "src"), "COUNTERFLEX_CACHE": str(scratch / "cache")}
    if interpreted:
        import numba

        os.environ["NUMBA_DISABLE_JIT"] = "1"
        numba.config.DISABLE_JIT = True
    import pytest
    from hypothesis import Phase, settings

    found = (Phase.explicit, Phase.reuse, Phase.generate)  # a defect is caught, however large the example that shows it
    settings.register_profile("planted", deadline=None, phases=found)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", "--hypothesis-seed=0", "--benchmark-disable"]
    options += ["--hypothesis-profile=planted"]
    options += ["--tb=line", "-W", "ignore::pytest.PytestAssertRewriteWarning", f"--basetemp={scratch / 'tmp'}"]
    if last:
        watch = _Watch([])
        pytest.main([*options, last], plugins=[watch.hook()])
        if watch.failed == last:  # and not: it is gone or cannot be collected
            return last
    for files in batches:
        watch = _Watch(files)
        code = pytest.main([*options, *files], plugins=[watch.hook()])
        if watch.failed or code not in (0, 5):  # 4 and more: the tests themselves cannot be run
            return watch.failed or f"exit status {int(code)} of {' '.join(files)}"
    return ""


class Bench:
    """A scratch copy of the tree, in which one defect at a time is planted."""

    def __init__(self, folder: Path) -> None:
        """Copy source and tests, link everything else that is tracked, and the kernels compiled so far."""
        self.folder = folder
        folder.mkdir(parents=True)
        for name in ("src", "tests"):
            shutil.copytree(ROOT / name, folder / name)
        for entry in ROOT.iterdir():
            if entry.name not in ("src", "tests", "out", ".git", ".hypothesis"):
                (folder / entry.name).symlink_to(entry)
        cache = Path(os.environ.get("COUNTERFLEX_CACHE", Path.home() / ".cache" / "counterflex"))
        if cache.is_dir():
            shutil.copytree(cache, folder / "cache", ignore_dangling_symlinks=True)
        self.defect: Defect | None = None
        self.started = 0.0
        self.files: tuple[list[str], list[str]] = ([], [])
        self.caught = read_caught()

    def _write(self, file: str, text: str) -> None:
        path = self.folder / file
        path.write_text(text, encoding="utf-8")
        for stale in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            stale.unlink()

    def start(self, defect: Defect, own: int, above: int) -> int:
        """Plant a defect and fork a process that runs its tests; the process' number."""
        self.defect, self.started = defect, time.monotonic()
        self.files = defect.nearest(own, above)
        self._write(defect.file, defect.after)
        child = os.fork()
        if child:
            return child
        os.setsid()
        result = ""
        try:
            batches = [self.files[0][:_FIRST], self.files[0][_FIRST:], self.files[1]]
            last = self.caught.get(defect.name, "")
            result = _run_tests(self.folder, last, [batch for batch in batches if batch], defect.interpreted)
        except BaseException as error:
            result = f"{type(error).__name__}"
        (self.folder / "result.txt").write_text(result)
        os._exit(0)

    def end(self, late: bool) -> dict[str, Any]:
        """Take the defect out again and return the row of its result."""
        defect = self.defect
        assert defect is not None
        self._write(defect.file, defect.before)
        self.defect = None
        result = self.folder / "result.txt"
        failed = result.read_text() if result.exists() else ""
        result.unlink(missing_ok=True)
        own = failed.startswith(f"tests/{defect.room}/") or failed.split("::")[0] in defect.tests
        outcome = "late" if late else "own" if own else "above" if failed.startswith("tests/") else "survived"
        outcome = "broken" if failed and not failed.startswith("tests/") else outcome
        row = {"name": defect.name, "room": defect.room, "kind": defect.kind, "file": defect.file}
        row |= {"digest": defect.digest, "outcome": outcome, "by": failed, "tests": _digest_tests(self.files)}
        return row | {"seconds": round(time.monotonic() - self.started, 1)}


def _digest_tests(files: tuple[list[str], list[str]]) -> str:
    """Short hash of the test files that looked for a defect."""
    digest = hashlib.sha256()
    for name in [*files[0], *files[1]]:
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()[:16]


def _is_done(defect: Defect, row: dict[str, Any] | None, own: int, above: int) -> bool:
    if row is None or row["digest"] != defect.digest:
        return False
    if row["outcome"] == "own":
        return True
    return bool(row["tests"] == _digest_tests(defect.nearest(own, above)))


def run(defects: list[Defect], jobs: int, own: int, above: int, limit_s: float, kept: Path) -> None:
    """Run defects, ``jobs`` at a time, and append each result to a file of lines."""
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell that starts it in the background ignores the first
        signal.signal(number, signal.default_int_handler)
    for name in _LIBRARIES:
        importlib.import_module(name)
    folder = Path(tempfile.mkdtemp(prefix="planted-"))
    todo = list(reversed(defects))
    free = [Bench(folder / str(number)) for number in range(min(jobs, len(todo)))]
    busy: dict[int, Bench] = {}
    try:
        while todo or busy:
            while todo and free:
                bench = free.pop()
                busy[bench.start(todo.pop(), own, above)] = bench
            child, _ = os.waitpid(-1, os.WNOHANG)
            late = [pid for pid, bench in busy.items() if time.monotonic() - bench.started > limit_s]
            if not child and late:
                child = late[0]
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
            if not child:
                time.sleep(0.05)
                continue
            bench = busy.pop(child)
            row = bench.end(child in late)
            free.append(bench)
            with kept.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(row) + "\n")
            print(f"{row['outcome']:<8} {row['seconds']:6.1f} s  {row['room']}: {row['name']}  {row['by']}", flush=True)
    finally:
        for pid in busy:
            os.killpg(pid, signal.SIGKILL)
        shutil.rmtree(folder, ignore_errors=True)


def read_results(kept: Path) -> dict[str, dict[str, Any]]:
    """Last result of each defect by name."""
    if not kept.is_file():
        return {}
    return {row["name"]: row for row in map(json.loads, kept.read_text(encoding="utf-8").splitlines())}


def read_caught() -> dict[str, str]:
    """Test that caught each defect of the kept set last, by the defect's name."""
    return dict(json.loads(CAUGHT.read_text(encoding="utf-8"))) if CAUGHT.is_file() else {}


def remember(defects: list[Defect], results: dict[str, dict[str, Any]]) -> None:
    """Write which test caught each defect, those of other defects as they were; what is no longer of the set goes."""
    caught = read_caught()
    for defect in defects:
        row = results.get(defect.name)
        if row and row["digest"] == defect.digest and row["outcome"] in ("own", "above"):
            caught[defect.name] = row["by"]
    names = {one.name for one in read_set()[0]}
    text = json.dumps({name: by for name, by in sorted(caught.items()) if name in names}, indent=0, ensure_ascii=False)
    CAUGHT.write_text(text + "\n", encoding="utf-8")


def report(defects: list[Defect], results: dict[str, dict[str, Any]]) -> str:
    """Score by room and the survivors by name, as a page of Markdown prints them."""
    rooms: dict[str, Counter[str]] = {}
    survivors = []
    for defect in defects:
        row = results.get(defect.name)
        outcome = row["outcome"] if row and row["digest"] == defect.digest else "not run"
        rooms.setdefault(defect.room, Counter())[outcome] += 1
        if outcome not in ("own", "above"):
            survivors.append(f"- {outcome}: {defect.room}: {defect.name}")
    lines = ["| room | defects | caught in own room | caught above | survived | not run |", "|---|---|---|---|---|---|"]
    total: Counter[str] = Counter()
    for room, counts in sorted(rooms.items()):
        total += counts
        missed = counts.total() - counts["own"] - counts["above"] - counts["not run"]
        cells = (counts.total(), counts["own"], counts["above"], missed, counts["not run"])
        lines.append(f"| {room} | {' | '.join(map(str, cells))} |")
    every = max(total.total() - total["not run"], 1)
    caught = total["own"] + total["above"]
    share, inside = f"{100 * caught / every:.1f} %", f"{100 * total['own'] / every:.1f} %"
    last = (total.total(), f"{total['own']} ({inside})", total["above"], total.total() - caught - total["not run"])
    lines.append(f"| all | {' | '.join(map(str, last))} | {total['not run']} |")
    return "\n".join([*lines, "", f"Caught, of those that were run: {share}.", *survivors])


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--room", action="append", default=[], help="only this room; may be repeated, in the order to run"
    )
    parser.add_argument("--only", default="", help="only defects whose name contains this")
    parser.add_argument("--changed", metavar="SINCE", help="random defects in lines that differ from this commit")
    parser.add_argument("--random", type=int, default=0, metavar="N", help="draw N random defects instead of the set")
    parser.add_argument("--per-room", type=int, default=0, metavar="N", help="draw N of each room, the rooms in turn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--own", type=int, default=8, help="test files of the own room, nearest first")
    parser.add_argument("--above", type=int, default=2, help="test files of rooms above, nearest first")
    parser.add_argument("--limit-s", type=float, default=240.0, help="a run that takes longer is stopped")
    parser.add_argument("--kept", type=Path, default=ROOT / "out" / "planted.jsonl", help="file of results")
    parser.add_argument("--remember", action="store_true", help="write which tests caught them beside the kept set")
    parser.add_argument("--report", action="store_true", help="print the score of what has been run")
    options = parser.parse_args()
    if options.random or options.changed:
        defects = random_defects(options.changed, options.room, options.random or 20, options.seed)
    else:
        defects, stale = read_set()
        for line in stale:
            print(f"stale: {line}", file=sys.stderr)
    defects = [one for one in defects if (not options.room or one.room in options.room) and options.only in one.name]
    if options.room:
        defects.sort(key=lambda one: options.room.index(one.room))
    if options.per_room:
        defects = drawn_per_room(defects, options.per_room, options.seed)
    results = read_results(options.kept)
    if not options.report:
        options.kept.parent.mkdir(exist_ok=True)
        todo = [one for one in defects if not _is_done(one, results.get(one.name), options.own, options.above)]
        print(f"{len(defects)} defects, {len(todo)} to run")
        run(todo, options.jobs, options.own, options.above, options.limit_s, options.kept)
        results = read_results(options.kept)
    if options.remember and not options.random and not options.changed:
        remember(defects, results)
    print(report(defects, results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
