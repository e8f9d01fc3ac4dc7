"""Compiled kernels that come with the package: read where this user has none, and only as they were listed."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from counterflex.core import shipped

pytestmark = pytest.mark.skipif(platform.machine() not in shipped.BASELINES, reason="no baseline for this processor")
MODULE = "counterflex.signals.filters"
_COMPILE = f"""
import json, hashlib, sys
from pathlib import Path
from importlib import import_module
import_module("{MODULE}")
from counterflex.core import jit, shipped
(one,) = jit.entries("{MODULE}")
one.compile_stated()
folder, base = jit.cache_folder("{MODULE}"), one._cache._impl.filename_base
out = Path(sys.argv[1])
(out / folder.name).mkdir(parents=True)
files = {{}}
for file in sorted(folder.glob(base + ".*")):
    if file.suffix in (".nbi", ".nbc"):
        copied = out / folder.name / file.name
        copied.write_bytes(file.read_bytes())
        files[folder.name + "/" + file.name] = hashlib.sha256(copied.read_bytes()).hexdigest()
target = list(one.targetctx.codegen().magic_tuple())
(out / shipped.LIST).write_text(json.dumps({{"target": target, "features": sys.argv[2].split(), "files": files}}))
"""
_USE = f"""
import sys
from pathlib import Path
from importlib import import_module
import numpy as np
from counterflex.core import jit, shipped
shipped.FOLDER = Path(sys.argv[1])
module = import_module("{MODULE}")
(one,) = jit.entries("{MODULE}")
kept = str(one.kept())
one.compile_stated()
made = sorted(file.name for file in jit.cache_folder("{MODULE}").rglob("*.nbc"))
print(kept, len(made), [str(signature) for signature in one.signatures] != [])
"""


def run(script: str, *words: str, cache: Path, **more: str) -> str:
    """What a fresh interpreter prints, with a cache of its own."""
    environment = os.environ | {"COUNTERFLEX_CACHE": str(cache)} | more
    ended = subprocess.run(
        [sys.executable, "-c", script, *words], env=environment, capture_output=True, text=True, check=True
    )
    return ended.stdout.strip()


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One kernel, compiled for the baseline processor."""
    folder = tmp_path_factory.mktemp("shipped")
    baseline = shipped.BASELINES[platform.machine()]
    run(
        _COMPILE,
        str(folder / "kernels"),
        " ".join(baseline.features),
        cache=folder / "made",
        NUMBA_CPU_NAME=baseline.cpu,
        NUMBA_CPU_FEATURES="",
    )
    return folder / "kernels"


def test_code_of_the_package_is_read_and_nothing_is_compiled(brought: Path, tmp_path: Path) -> None:
    assert run(_USE, str(brought), cache=tmp_path / "own") == "shipped 0 True"


def test_where_the_loop_runs_it_is_compiled_for_this_processor(brought: Path, tmp_path: Path) -> None:
    assert run(_USE, str(brought), cache=tmp_path / "own", COUNTERFLEX_NATIVE="1") == "missing 1 True"
    assert run(_USE, str(brought), cache=tmp_path / "own") == "native 1 True"


def test_a_file_that_is_not_the_listed_one_is_not_read(brought: Path, tmp_path: Path) -> None:
    """It would be executed: another is compiled instead."""
    changed = tmp_path / "kernels"
    (folder,) = [one for one in brought.iterdir() if one.is_dir()]
    (changed / folder.name).mkdir(parents=True)
    (changed / shipped.LIST).write_bytes((brought / shipped.LIST).read_bytes())
    for file in folder.iterdir():
        text = file.read_bytes()
        (changed / folder.name / file.name).write_bytes(text[:-1] + bytes([text[-1] ^ 1]))
    assert run(_USE, str(changed), cache=tmp_path / "own") == "missing 1 True"


def test_a_processor_that_lacks_something_compiles(brought: Path, tmp_path: Path) -> None:
    other = tmp_path / "kernels"
    (folder,) = [one for one in brought.iterdir() if one.is_dir()]
    (other / folder.name).mkdir(parents=True)
    for file in folder.iterdir():
        (other / folder.name / file.name).write_bytes(file.read_bytes())
    listed = json.loads((brought / shipped.LIST).read_text())
    (other / shipped.LIST).write_text(json.dumps(listed | {"features": [*listed["features"], "of-another-time"]}))
    assert run(_USE, str(other), cache=tmp_path / "own") == "missing 1 True"
