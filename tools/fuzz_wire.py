"""Fuzz the readers of telegrams: seeded, judged by independent readers, guided by the branches that inputs reach.

Inputs are damaged telegrams. Nothing may be accepted that the judge refuses, numbers must be equal where both accept,
and no exception may come but the package's own. Kernels are run a second time with counters in their branches: an input
that reaches something new is kept and damaged further. What is kept at the end, each input made as short as it reaches
the same, is the corpus in tests/data/fuzz/TARGET, which the tests replay.

    python tools/fuzz_wire.py --target rsi --inputs 1000000 --seed 1
    python tools/fuzz_wire.py --target all --inputs 1000000 --json fuzz.json
    python tools/fuzz_wire.py --target rsi --inputs 200000 --keep tests/data/fuzz
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from fuzz_mutations import Mutator
from fuzz_target import Finding, Target
from fuzz_targets import TARGETS

_MOST_KEPT = 4000
_SLOW_TRIES = 7


def fuzz(
    name: str, inputs: int, seed: int, folder: Path | None, *, compiled: bool = True
) -> tuple[dict[str, Any], list[bytes]]:
    """Fuzz one reader.

    Args:
        name: Of :data:`TARGETS`.
        inputs: How many.
        seed: The same gives the same inputs.
        folder: A corpus to begin with, besides the target's own telegrams; or None.
        compiled: False runs the counted kernels as plain Python.

    Returns:
        Figures, and the corpus.

    Raises:
        Finding: Reader and judge differ; the message holds the input.
    """
    target = TARGETS[name](compiled=compiled)
    mutate = Mutator(seed, text=target.text)
    corpus = (
        [*target.seeds, *(p.read_bytes() for p in sorted((folder / name).glob("*.bin")))] if folder else [*target.seeds]
    )
    clock = time.perf_counter_ns
    accepted, slowest_ns, slowest = 0, 0, b""
    begin = time.perf_counter()
    for k in range(-len(corpus), inputs):
        data = corpus[k] if k < 0 else mutate(mutate.choose(corpus), mutate.choose(corpus))
        try:
            start = clock()
            good = target.check(data)
            took = clock() - start
        except Exception as fault:
            raise Finding(
                f"{name}, seed {seed}, input {k}: {type(fault).__name__}: {fault}: {data[:2000]!r}"
            ) from fault
        accepted += good
        if k >= 0 and not good and took > slowest_ns:
            slowest_ns, slowest = took, data
        if target.coverage is not None and target.instrumented is not None:
            target.instrumented(data)
            if target.coverage.new() and k >= 0 and len(corpus) < _MOST_KEPT and len(data) < 4000:
                corpus.append(data)
    seconds = time.perf_counter() - begin
    reached, branches = target.coverage.branches if target.coverage else (0, 0)
    figures = {
        "inputs": inputs,
        "seed": seed,
        "accepted": accepted,
        "corpus": len(corpus),
        "branches": branches,
        "branches_reached": reached,
        "slowest_us": round(_slowest(target, [slowest, b"9" * 65_000, *target.seeds]), 1),
        "seconds": round(seconds, 1),
        "per_second": round(inputs / seconds),
    }
    return figures, corpus


def _slowest(target: Target, candidates: list[bytes]) -> float:
    """Largest time to read one of some inputs, us; of each the least of several tries: the reader's own."""
    out = 0.0
    for data in candidates:
        tries = []
        for _ in range(_SLOW_TRIES):
            start = time.perf_counter_ns()
            target.read(data)
            tries.append(time.perf_counter_ns() - start)
        out = max(out, min(tries) / 1e3)
    return out


def smallest(name: str, corpus: list[bytes], *, compiled: bool = True) -> list[bytes]:
    """Few short inputs that reach what a corpus reaches: chosen greedily, then cut as long as each reaches the same."""
    target = TARGETS[name](compiled=compiled)
    if target.coverage is None or target.instrumented is None:
        return list(target.seeds)
    run, coverage = target.instrumented, target.coverage

    def reached(data: bytes) -> frozenset[tuple[int, int]]:
        run(data)
        return coverage.signature()

    wanted = {data: reached(data) for data in sorted(set(corpus), key=len)}
    left: set[tuple[int, int]] = set().union(*wanted.values())
    out: list[bytes] = []
    while left:
        best = max(wanted, key=lambda data: (len(wanted[data] & left), -len(data)))
        mine = wanted[best] & left
        left -= mine
        out.append(_cut(best, frozenset(mine), reached))
    return out


def _cut(data: bytes, needed: frozenset[tuple[int, int]], reached: Any) -> bytes:
    size = max(1, len(data) // 2)
    while size:
        at = 0
        while at < len(data):
            shorter = data[:at] + data[at + size :]
            if needed <= reached(shorter):
                data = shorter
            else:
                at += size
        size //= 2
    return data


def keep(name: str, corpus: list[bytes], folder: Path, *, compiled: bool = True) -> int:
    """Write the smallest corpus into ``folder/name`` in the place of what is there; returns how many files."""
    place = folder / name
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.bin"):
        old.unlink()
    chosen = smallest(name, corpus, compiled=compiled)
    for data in chosen:
        (place / f"{hashlib.sha256(data).hexdigest()[:12]}.bin").write_bytes(data)
    return len(chosen)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line, fuzz, print; exit status 1 where something was found."""
    parser = argparse.ArgumentParser(description="Fuzz the readers of telegrams")
    parser.add_argument("--target", choices=[*TARGETS, "all"], default="all")
    parser.add_argument("--inputs", type=int, default=1_000_000, help="per target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--corpus", type=Path, help="folder of corpora to begin with, TARGET/*.bin")
    parser.add_argument("--keep", type=Path, help="write the smallest corpus into this folder")
    parser.add_argument("--plain", action="store_true", help="run the counted kernels as plain Python (slow)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    given = parser.parse_args(arguments)
    warnings.simplefilter("error")
    results: dict[str, Any] = {}
    for name in list(TARGETS) if given.target == "all" else [given.target]:
        try:
            results[name], corpus = fuzz(name, given.inputs, given.seed, given.corpus, compiled=not given.plain)
        except Finding as found:
            print(f"FOUND {found}", file=sys.stderr)
            return 1
        line = results[name]
        print(
            f"{name:10s} {line['inputs']:8d} inputs, {line['accepted']:7d} accepted, "
            f"{line['branches_reached']:3d} of {line['branches']:3d} branches, slowest {line['slowest_us']:8.1f} us, "
            f"{line['seconds']:6.1f} s",
            flush=True,
        )
        if given.keep:
            count = keep(name, corpus, given.keep, compiled=not given.plain)
            print(f"{name:10s} kept {count} inputs in {given.keep / name}")
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
