"""Build the wheel that brings its compiled kernels, for this Python and this kind of processor; install it, time it.

    python tools/build_wheels.py dist
    python tools/build_wheels.py dist --time

The kernels are compiled for a baseline processor (`counterflex.core.shipped`), from an empty cache. What a kernel calls
is part of its code: only the files of those that Python calls go into the wheel. --time installs it, with the hashed
requirements, in an empty environment, and prints the processor seconds of first commands there: none may compile.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
_ENTRIES: Final = """
import json
from counterflex.app import warm
from counterflex.core.jit import cache_folder, entries
from importlib import import_module
out = []
for module in warm.modules():
    name = "counterflex." + module
    import_module(name)
    for one in entries(name):
        folder, base = cache_folder(name), one._cache._impl.filename_base
        out += [str(file) for file in sorted(folder.glob(base + ".*")) if file.suffix in (".nbi", ".nbc")]
        target = list(one.targetctx.codegen().magic_tuple())
print(json.dumps({"files": sorted(set(out)), "target": target}))
"""


def compiled(folder: Path) -> Path:
    """Compile all kernels for the baseline of this machine.

    Args:
        folder: Empty; gets `cache` and `kernels`.

    Returns:
        The folder that goes into the wheel.
    """
    from counterflex.core import shipped

    baseline = shipped.BASELINES[platform.machine()]
    environment = os.environ | {
        "COUNTERFLEX_CACHE": str(folder / "cache"),
        shipped.NATIVE_ONLY: "1",
        "NUMBA_CPU_NAME": baseline.cpu,
        "NUMBA_CPU_FEATURES": "",
    }
    subprocess.run([sys.executable, "-m", "counterflex", "warm"], env=environment, check=True)
    command = [sys.executable, "-c", _ENTRIES]
    said = json.loads(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    kernels, files = folder / shipped.FOLDER.name, {}
    for file in map(Path, said["files"]):
        place = kernels / file.parent.name / file.name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
        files[place.relative_to(kernels).as_posix()] = hashlib.sha256(place.read_bytes()).hexdigest()
    made = {"target": said["target"], "features": list(baseline.features), "files": files}
    (kernels / shipped.LIST).write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    return kernels


def built(kernels: Path, out: Path) -> Path:
    """Build the wheel with these kernels; returns its path."""
    before = set(out.glob("*.whl"))
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    subprocess.run(command, cwd=ROOT, env=os.environ | {"COUNTERFLEX_KERNELS": str(kernels)}, check=True)
    made = set(out.glob("*.whl")) - before or set(out.glob("*.whl"))
    return max(made, key=lambda file: file.stat().st_mtime)


def timed(wheel: Path, folder: Path) -> dict[str, float]:
    """Processor seconds of first commands in an environment that holds the wheel and what it requires, nothing else."""
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    python = folder / "venv" / "bin" / "python"
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    subprocess.run([*pip, "--require-hashes", "-r", str(ROOT / "requirements" / "run.txt")], check=True)
    subprocess.run([*pip, "--no-deps", str(wheel)], check=True)
    examples, cell = ROOT / "examples", str(ROOT / "examples/cells/kr300_d16_small.toml")
    commands = {
        "first --version": ["--version"],
        "first pose": ["pose", "kuka_kr300_r2500_ultra", "--joints-deg", "0,-90,90,0,0,0"],
        "first compensate": ["compensate", str(examples / "programs/groove.ngc"), "--cell", cell, "--out", "plan"],
        "second compensate": ["compensate", str(examples / "programs/groove.ngc"), "--cell", cell, "--out", "again"],
        "first demo": ["demo", "--out", "demo"],
    }
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"COUNTERFLEX_CACHE": str(folder / "empty")}
    out = {}
    for name, words in commands.items():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [str(python), "-m", "counterflex", *words], cwd=folder, env=environment, capture_output=True, text=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{name}: {done.stderr}")
        out[name] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        compiled_now = len(list((folder / "empty").rglob("*.nbc")))
        print(f"| {name} | {out[name]:.1f} s | {compiled_now} kernels compiled so far |", flush=True)
    return out


def main() -> None:
    """Build, and time where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the wheel")
    parser.add_argument(
        "--time", action="store_true", help="install it in an empty environment and time first commands"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kernels = compiled(folder)
        wheel = built(kernels, asked.out.resolve())
        size = sum(file.stat().st_size for file in kernels.rglob("*") if file.is_file())
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, kernels {size / 1e6:.1f} MB before packing")
        if asked.time:
            timed(wheel, folder)


if __name__ == "__main__":
    main()
