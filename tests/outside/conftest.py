"""The example package, installed into a folder of its own and found as any installed package is."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from counterflex.core import registry
from counterflex.cutting import material
from counterflex.robot.model import catalog
from made_once import made_once

HERE = Path(__file__).parent
PIP = ("-m", "pip", "--disable-pip-version-check", "--quiet", "install")
LOCAL = ("--no-build-isolation", "--no-deps", "--no-index")


def _forget() -> None:
    """What was looked up before the path changed."""
    registry._outside.cache_clear()
    for lookup in (material._others, catalog.entry, catalog.load):
        lookup.cache_clear()
    importlib.invalidate_caches()


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the package and its metadata."""

    def install(folder: Path) -> None:
        subprocess.run([sys.executable, *PIP, *LOCAL, "--target", str(folder), str(HERE)], check=True, timeout=120)

    return made_once(tmp_path_factory, "site", install)


@pytest.fixture
def example(installed: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The package on the path of this process."""
    monkeypatch.syspath_prepend(str(installed))
    _forget()
    yield installed
    monkeypatch.undo()
    _forget()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str, str], None]]:
    """Puts a package on the path that registers one object: ``package(group, line, source of module added)``."""

    def put(group: str, line: str, source: str = "") -> None:
        (tmp_path / "added.py").write_text(source, encoding="utf-8")
        info = tmp_path / "added-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: added\nVersion: 1.0\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[{group}]\n{line}\n", encoding="utf-8")
        monkeypatch.syspath_prepend(str(tmp_path))
        _forget()

    yield put
    monkeypatch.undo()
    sys.modules.pop("added", None)
    _forget()
