"""Files on their way to a worker and back: nothing else travels, and nothing gets out of its folder."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

import cluster_steps as steps
from counterflex.app.long_jobs.on_worker import ordered, packed, taken, unpacked
from counterflex.app.long_jobs.step_cache import program_files
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, ReachError


def job(folder: Path) -> tuple[Path, Task]:
    """A job's folder, and the first of its tasks."""
    (folder / "in.txt").write_text("x", encoding="ascii")
    return folder, steps.tasks_in(folder, folder / "log")[0]


def evil(name: str, folder: Path) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("facts.json", json.dumps({"result": 1}))
        archive.writestr(f"files/{name}", "evil")
    return data.getvalue()


def test_a_task_needs_no_shared_disk(tmp_path: Path) -> None:
    root, task = job(tmp_path)
    task = replace(task, reads=(task.arguments[0].path,))
    order = pickle.loads(pickle.dumps(ordered(task, root)))
    (root / "in.txt").unlink()  # it travels with the order
    told: list[float] = []

    def report(fraction: float, what: str = "") -> None:
        told.append(fraction)

    parcel = order.carry_out(report)
    assert not (root / "copy-0").exists()
    assert taken(parcel, task, root) == {"k": 0}
    assert (root / "copy-0" / "copy.txt").read_text(encoding="ascii") == "x0"
    assert told == [0.5]


def test_a_fault_is_that_of_the_task_with_the_names_of_this_machine(tmp_path: Path) -> None:
    root, _ = job(tmp_path)
    task = Task("far", "", steps.unreachable, (Reads(str(root / "in.txt")),))
    fault = taken(ordered(task, root).carry_out(), task, root)
    assert isinstance(fault, ReachError)
    assert str(fault) == f"{root / 'in.txt'}:3: out of reach; got 1.5; expected <= 1. Move the part"
    broken = Task("b", "", steps.broken)
    fault = taken(ordered(broken, root).carry_out(), broken, root)
    assert isinstance(fault, RuntimeError)
    assert "cluster_steps.py" in str(fault)


def test_a_worker_with_another_program_refuses(tmp_path: Path) -> None:
    root, task = job(tmp_path)
    parcel = replace(ordered(task, root), program="0.0.1 (abc)").carry_out()
    with pytest.raises(InputError, match="another counterflex"):  # raised, not a result: it ends the job
        taken(parcel, task, root)
    assert not (root / "log").exists()


def test_the_part_of_a_program_that_differs_is_named(tmp_path: Path) -> None:
    """Say somebody has edited it between the start of the job and that of the worker."""
    root, task = job(tmp_path)
    here = dict(program_files())
    for rooms, named in (({**here, "code of plan": "0"}, "code of plan: "), (here | {"new": "1"}, "new: "), (7, "")):
        parcel = packed(root, (), {"other": "0.0.1 (abc)", "rooms": rooms})
        with pytest.raises(InputError, match=f"^{named}a worker runs another counterflex"):
            taken(parcel, task, root)


def test_nothing_of_this_machine_is_sent_but_the_job(tmp_path: Path) -> None:
    root, _ = job(tmp_path)
    other = tmp_path.parent / f"{tmp_path.name}-secret"
    other.touch()
    with pytest.raises(InputError, match="outside the folder"):
        ordered(Task("x", "", steps.unreachable, (Reads(str(other)),)), root)


@pytest.mark.parametrize(
    "name", ["../evil", "copy-0/../../evil", "/evil", "copy-1/evil", "copy-00/evil", "..\\evil", "copy-0/c:evil"]
)
def test_no_file_gets_out_of_its_folder(tmp_path: Path, name: str) -> None:
    root, task = job(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(FileFormatError, match="not of its task"):
        taken(evil(name, tmp_path), task, root)
    assert sorted(tmp_path.rglob("*")) == before
    assert isinstance(task.arguments[1], Writes)


@pytest.mark.parametrize(
    "data",
    [b"", b"PK", object(), "text", None, packed(Path(), (), {})[:-30]],
    ids=["empty", "two bytes", "object", "text", "none", "cut off"],  # an archive has the time in it
)
def test_what_is_no_parcel(tmp_path: Path, data: object) -> None:
    with pytest.raises(CounterflexError, match="parcel"):
        unpacked(data, tmp_path)


def test_a_file_that_fills_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("counterflex.app.long_jobs.on_worker.LARGEST_BYTES", 100)
    (tmp_path / "big").write_bytes(bytes(1000))
    with pytest.raises(FileFormatError, match="too large"):
        unpacked(packed(tmp_path, [tmp_path / "big"], {}), tmp_path)
