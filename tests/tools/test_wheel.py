"""What is built for users: a pure wheel with all that the package reads, and a source distribution that builds it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from counterflex import __version__
from counterflex.cli.main import LAB
from counterflex.core.build_data import commit, commit_of, sentence

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with wheel and source distribution of this work tree."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


@pytest.mark.long
def test_the_wheel_is_pure_and_holds_all_that_the_package_has(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.name == f"counterflex-{__version__}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        metadata = archive.read(f"counterflex-{__version__}.dist-info/METADATA").decode()
        entries = archive.read(f"counterflex-{__version__}.dist-info/entry_points.txt").decode()
        bill = archive.read(f"counterflex-{__version__}.dist-info/sboms/counterflex.cdx.json")
    source = ROOT / "src"
    wanted = {str(path.relative_to(source)) for path in source.rglob("*") if path.is_file()}
    wanted = {name for name in wanted if "__pycache__" not in name}
    assert wanted <= names
    assert not [name for name in names if name.endswith((".so", ".pyd", ".dll")) or name.startswith("tests/")]
    assert not [name for name in names if "_lab" in name.partition("/")[0]]
    assert "counterflex.commands" not in entries
    assert "counterflex = counterflex.cli.start:run" in entries
    assert bill == (ROOT / "requirements" / "counterflex.cdx.json").read_bytes()
    assert "License-Expression: Apache-2.0" in metadata
    assert re.search(r"^Requires-Python: .*>=3\.11", metadata, re.MULTILINE)


def test_the_laboratory_is_a_wheel_of_its_own_with_its_commands(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT / "lab", check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name == f"counterflex_lab-{__version__}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        entries = archive.read(f"counterflex_lab-{__version__}.dist-info/entry_points.txt").decode()
        metadata = archive.read(f"counterflex_lab-{__version__}.dist-info/METADATA").decode()
    source = ROOT / "lab"
    wanted = {str(path.relative_to(source)) for path in (source / "counterflex_lab").rglob("*") if path.is_file()}
    assert {name for name in wanted if "__pycache__" not in name} <= names
    assert all(f"\n{name} = counterflex_lab.commands." in entries for name in LAB)
    assert "Requires-Dist: counterflex\n" in metadata


def test_the_source_distribution_builds_the_same_wheel_without_git(built: Path, tmp_path: Path) -> None:
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (again,) = tmp_path.glob("*.whl")
    (first,) = built.glob("*.whl")
    with zipfile.ZipFile(first) as one, zipfile.ZipFile(again) as other:
        assert set(one.namelist()) == set(other.namelist())
        if commit() is not None:
            assert other.read("counterflex/commit.txt").decode().strip() == commit()


def test_the_installed_wheel_says_what_it_is(built: Path, tmp_path: Path) -> None:
    """From the wheel alone, found before the work tree; its commit is the one that it was built from."""
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    ended = subprocess.run(
        [sys.executable, "-m", "counterflex", "--version"], cwd=tmp_path, capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert ended.stdout.strip() == sentence(__version__)


def test_the_commit_is_read_as_git_keeps_it(tmp_path: Path) -> None:
    """Detached, in a loose and in a packed reference, and from a work tree of its own."""
    full = "0123456789abcdef0123456789abcdef01234567"
    git = tmp_path / ".git"
    (git / "refs/heads").mkdir(parents=True)
    assert commit_of(tmp_path) is None  # some other folder inside a repository
    (tmp_path / "pyproject.toml").touch()
    (git / "HEAD").write_text(f"{full}\n")
    assert commit_of(tmp_path) == full[:12]
    (git / "HEAD").write_text("ref: refs/heads/main\n")
    assert commit_of(tmp_path) is None  # before the first commit
    (git / "packed-refs").write_text(f"# pack-refs with: peeled\n{full} refs/heads/main\n")
    assert commit_of(tmp_path) == full[:12]
    (git / "refs/heads/main").write_text("f" * 40 + "\n")
    assert commit_of(tmp_path) == "f" * 12
    tree = tmp_path / "tree"
    own = git / "worktrees/tree"
    own.mkdir(parents=True)
    tree.mkdir()
    (tree / "pyproject.toml").touch()
    (tree / ".git").write_text(f"gitdir: {own}\n")
    (own / "HEAD").write_text("ref: refs/heads/main\n")
    (own / "commondir").write_text("../..\n")
    assert commit_of(tree) == "f" * 12
