"""Run a fixed set of jobs and take a digest of every number they write, so that a rebuilding can be judged.

``digest_jobs.toml`` beside this file names the jobs: demonstrations, compensated programs in each output language, one
identification of each recipe on simulated and on real data, closed loops over sockets in lockstep, a replayed log and
fault scenarios. Every job runs in its own folder below OUT through the command line, as a user would: modules can be
moved without a change here. OUT/digest.json then holds, for every file and every printed answer, the number of numbers,
the SHA-256 of their 64-bit values and the SHA-256 of the text between them.

``compare`` takes two such folders. Files whose numbers differ are listed with the number of differing values, the
largest absolute and relative difference and where it stands; files whose words differ, but not their numbers, are
listed apart. Exit status 1 when a number differs or a file is missing, 0 otherwise.

    python tools/digest.py run OUT [--quick] [--only JOB] [--workers N]
    python tools/digest.py compare BEFORE AFTER
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

ROOT = Path(__file__).resolve().parents[1]
JOBS = Path(__file__).with_name("digest_jobs.toml")
TEXT = {
    ".json",
    ".csv",
    ".toml",
    ".md",
    ".html",
    ".txt",
    ".ngc",
    ".src",
    ".dat",
    ".mod",
    ".xml",
    ".rsi",
    ".rsix",
    ".diagram",
}
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_BASE64 = re.compile(rb"[A-Za-z0-9+/=]{200,}")
_PORTS = threading.Lock()
"""Programs of several terminals talk over fixed ports: one such job at a time."""


@dataclass(frozen=True)
class Content:
    """Content of a file."""

    text: bytes  # everything but the numbers; names of columns where it is a table
    numbers: np.ndarray[tuple[int], np.dtype[np.float64]]  # all numbers in the order in which they stand, 1-D


@dataclass(frozen=True)
class Entry:
    """Digest of one file."""

    numbers: int  # how many numbers it holds
    values: str  # SHA-256 of their 64-bit values, in order
    text: str  # SHA-256 of everything else


@dataclass(frozen=True)
class Mask:
    """A part of the results that varies from run to run for a reason that is no arithmetic."""

    files: str  # pattern of the names of files
    pattern: str = ""  # text that is left out
    columns: tuple[str, ...] = ()  # columns of a CSV table that are left out

    def out_of(self, data: bytes) -> bytes:
        """The text of a file without what is masked."""
        if self.pattern:
            data = re.sub(self.pattern.encode(), b"<masked>", data, flags=re.MULTILINE)
        if self.columns:
            rows = [line.split(b",") for line in data.splitlines()]
            kept = [k for k, name in enumerate(rows[0]) if name.decode() not in self.columns]
            data = b"\n".join(b",".join(row[k] for k in kept) for row in rows)
        return data


def read(path: Path, masks: list[Mask]) -> Content:
    """Text and numbers of a file; what a mask matches is left out of both.

    Args:
        path: A text file, a Parquet table or anything else (then its bytes are the text).
        masks: What is left out.
    """
    if path.suffix == ".parquet":
        table = pl.read_parquet(path)
        columns = [c for c in table.columns if table[c].dtype.is_numeric() or table[c].dtype == pl.Boolean]
        rest = table.drop(columns)
        values = [table[c].cast(pl.Float64).fill_null(np.nan).to_numpy() for c in columns]
        return Content(f"{table.columns}{rest.rows()}".encode(), np.concatenate([*values, np.zeros(0)]))
    data = path.read_bytes()
    if path.suffix not in TEXT:
        return Content(hashlib.sha256(data).digest(), np.zeros(0))
    for mask in masks:
        if fnmatch.fnmatch(path.name, mask.files):
            data = mask.out_of(data)
    data = _BASE64.sub(lambda m: b"<" + re.sub(rb"\d", b"x", hashlib.sha256(m[0]).hexdigest().encode()) + b">", data)
    return Content(_NUMBER.sub(b"#", data), np.array([float(m) for m in _NUMBER.findall(data)]))


def digest(content: Content) -> Entry:
    """Digest of what a file says."""
    values = hashlib.sha256(np.ascontiguousarray(content.numbers, dtype="<f8").tobytes()).hexdigest()
    return Entry(content.numbers.size, values, hashlib.sha256(content.text).hexdigest())


def masks_of(jobs: dict[str, Any]) -> list[Mask]:
    """Read the masks of what varies from run to run from the list of jobs."""
    return [Mask(**{**m, "columns": tuple(m.get("columns", ()))}) for m in jobs["mask"]]


def files_of(folder: Path, jobs: dict[str, Any]) -> dict[str, Path]:
    """Every file below OUT that is judged, by its name below OUT."""
    out = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_file() and "/" in name and not any(fnmatch.fnmatch(name, s["files"]) for s in jobs["skip"]):
            out[name] = path
    return out


class JobError(Exception):
    """A command ended otherwise than it should."""


def _finish(process: subprocess.Popen[bytes], words: str, status: int, limit_s: float) -> None:
    try:
        got = process.wait(limit_s)
    except subprocess.TimeoutExpired:
        process.kill()
        raise JobError(f"{words}: not done after {limit_s:.0f} s") from None
    if got != status:
        raise JobError(f"{words}: exit status {got}, not {status}")


def run_job(job: dict[str, Any], out: Path, limit_s: float) -> float:
    """Run the steps of a job in its folder; a step that is a list runs its commands at the same time. Seconds taken.

    Raises:
        JobError: A command ends otherwise than it should, or does not end.
    """
    begun = time.monotonic()
    folder = out / job["name"]
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("examples", "tools"):
        (folder / name).symlink_to(ROOT / name)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "120", "NO_COLOR": "1"}
    for k, step in enumerate(job["steps"]):
        commands = step if isinstance(step, list) else [step]
        started = []
        for j, words in enumerate(commands):
            words, _, status = words.partition("  # exit ")
            with (
                (folder / f"said-{k}-{j}.txt").open("wb") as said,
                (folder / f"errors-{k}-{j}.log").open("wb") as errors,
            ):
                process = subprocess.Popen(shlex.split(words), cwd=folder, stdout=said, stderr=errors, env=environment)
            started.append((process, words, int(status or 0)))
        for process, words, code in started:
            _finish(process, f"{job['name']}: {words}", code, limit_s)
    return time.monotonic() - begun


def run(out: Path, *, quick: bool, only: list[str], workers: int) -> int:
    """Run the jobs and write OUT/digest.json; 1 where a job failed.

    Args:
        out: Folder; made where missing.
        quick: Only the jobs marked quick.
        only: Names of jobs; empty: all.
        workers: Jobs at a time.
    """
    jobs = tomllib.loads(JOBS.read_text())
    chosen = [j for j in jobs["job"] if (not quick or j.get("quick")) and (not only or j["name"] in only)]
    if not chosen:
        raise SystemExit(f"no such job; there are {', '.join(j['name'] for j in jobs['job'])}")
    out.mkdir(parents=True, exist_ok=True)
    failed: list[str] = []

    def one(job: dict[str, Any]) -> None:
        with _PORTS if job.get("sockets") else nullcontext():
            try:
                print(f"{job['name']}: {run_job(job, out, 3600.0):.1f} s", flush=True)
            except JobError as error:
                print(error, flush=True)
                failed.append(job["name"])

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(one, chosen))
    masks = masks_of(jobs)
    entries = {name: asdict(digest(read(path, masks))) for name, path in files_of(out, jobs).items()}
    (out / "digest.json").write_text(json.dumps(entries, indent=1, sort_keys=True) + "\n")
    total = sum(e["numbers"] for e in entries.values())
    print(f"{len(entries)} files, {total} numbers: {out / 'digest.json'}")
    if failed:
        print(f"failed: {', '.join(failed)}; what they said is in their folders, errors-*.log")
    return int(bool(failed))


def _difference(a: Content, b: Content) -> str:
    if a.numbers.size != b.numbers.size:
        return f"{a.numbers.size} numbers before, {b.numbers.size} after"
    same = (a.numbers == b.numbers) | (np.isnan(a.numbers) & np.isnan(b.numbers))
    with np.errstate(invalid="ignore"):
        off = np.where(same, 0.0, np.abs(a.numbers - b.numbers))
    worst = int(np.nanargmax(off))
    relative = off[worst] / max(abs(a.numbers[worst]), abs(b.numbers[worst]), 1e-300)
    return (
        f"{np.count_nonzero(~same)} of {same.size} differ, most {off[worst]:.3g} (relative {relative:.2g})"
        f" at number {worst}: {a.numbers[worst]!r} before, {b.numbers[worst]!r} after"
    )


def compare(before: Path, after: Path) -> int:
    """Print what differs; 1 where numbers do or files are missing."""
    jobs = tomllib.loads(JOBS.read_text())
    masks = masks_of(jobs)
    old, new = (json.loads((p / "digest.json").read_text()) for p in (before, after))
    bad = 0
    worded = []
    for name in sorted({*old, *new}):
        if name not in old or name not in new:
            bad += 1
            print(f"{name}: only {'before' if name in old else 'after'}")
        elif (old[name]["numbers"], old[name]["values"]) != (new[name]["numbers"], new[name]["values"]):
            bad += 1
            paths = before / name, after / name
            there = all(p.exists() for p in paths)
            print(f"{name}: {_difference(*(read(p, masks) for p in paths)) if there else 'numbers differ'}")
        elif old[name]["text"] != new[name]["text"]:
            worded.append(name)
    for name in worded:
        print(f"{name}: words differ, numbers do not")
    print(f"{len(old)} files before, {len(new)} after: {bad} differ in numbers, {len(worded)} in words only")
    return int(bad > 0)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run", help="run the jobs and take their digest")
    running.add_argument("out", type=Path)
    running.add_argument("--quick", action="store_true", help="only the short jobs")
    running.add_argument("--only", action="append", default=[], metavar="JOB")
    running.add_argument("--workers", type=int, default=2)
    comparing = commands.add_parser("compare", help="compare two digests")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "compare":
        return compare(given.before, given.after)
    return run(given.out.resolve(), quick=given.quick, only=given.only, workers=given.workers)


if __name__ == "__main__":
    sys.exit(main())
