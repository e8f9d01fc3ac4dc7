"""A run for other viewers: MCAP as Foxglove reads it, checked by another reader; ``.rrd`` by rerun itself."""

from __future__ import annotations

import json
from collections import defaultdict
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from counterflex.app.log_export.content import EVERY, content_of
from counterflex.app.log_export.foxglove import SCHEMAS
from counterflex.app.log_export.job import export_to
from counterflex.cli.main import whole
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.robot.elasticity.chain import frames
from counterflex.runtime.record_ring import column
from straight_cut_log import CYCLES, FEED, rows_of, write

Q = np.radians([10.0, -80.0, 110.0, 0.0, 30.0, 0.0])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    with resources.as_file(resources.files("counterflex.app") / "demo" / "cell.toml") as file:
        cell = tmp_path / "cell.toml"
        cell.write_bytes(file.read_bytes())
    rows = rows_of()
    first = column("q1")
    rows[:, first : first + 6] = Q
    rows[:, column("correction_rz")] = 1e-3
    return write(tmp_path / "log", rows, cell=cell)


def messages(file: Path) -> dict[str, list[tuple[int, Any]]]:
    out = defaultdict(list)
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            layout = json.loads(schema.data)
            assert layout == SCHEMAS.get(schema.name, layout)
            content = json.loads(message.data)
            assert set(content) <= set(layout["properties"])
            out[channel.topic].append((message.log_time, content))
    return out


def test_what_foxglove_gets_is_what_was_logged(log: Path, tmp_path: Path) -> None:
    done = export_to(log, "foxglove", tmp_path / "run.mcap", range_m=2e-4)
    seen = messages(tmp_path / "run.mcap")
    assert done["messages"] == sum(len(one) for one in seen.values())
    begin = round(1.8e9 * 1e9 + 1e9)
    assert [time for time, _ in seen["/loop"]] == [begin + 4_000_000 * k for k in range(CYCLES)]
    assert {one["across_um"] for _, one in seen["/deviation_remaining"]} == {20.0}
    assert {one["measured_n"] for _, one in seen["/force"]} == {200.0}
    assert "/deviation_measured" not in seen  # without a tracker there is no such curve
    texts = [one["message"] for _, one in seen["/log"]]
    assert texts == ["state ACTIVE", "anna: stop: done", "state HOLD: operator"]
    assert [one["level"] for _, one in seen["/log"]] == [2, 3, 3]


def test_frames_are_the_commanded_pose_and_the_joints_of_the_cell(log: Path, tmp_path: Path) -> None:
    export_to(log, "foxglove", tmp_path / "run.mcap", range_m=2e-4)
    poses = defaultdict(list)
    for _, one in messages(tmp_path / "run.mcap")["/tf"]:
        poses[one["parent_frame_id"], one["child_frame_id"]].append(one)
    commanded = poses["part", "commanded"]
    assert len(commanded) == CYCLES // EVERY
    assert commanded[-1]["translation"]["x"] == pytest.approx(FEED * 0.004 * (CYCLES - EVERY), rel=1e-9)
    corrected = poses["part", "corrected"][-1]
    assert corrected["translation"]["y"] == pytest.approx(-8e-5, rel=1e-9)
    quats = [np.array([one["rotation"][a] for a in "wxyz"]) for one in (commanded[-1], corrected)]
    turn = rotation.log(rotation.from_quat_wxyz(quats[1]) @ rotation.from_quat_wxyz(quats[0]).T)
    assert np.allclose(turn, [0.0, 0.0, 1e-3], atol=1e-9)
    chain = read_cell(tmp_path / "cell.toml").controller_chain
    T = frames(chain, Q)[int(np.flatnonzero(chain.joint == 5)[0])]
    joint = poses["base", "joint6"][0]["translation"]
    assert np.allclose([joint[a] for a in "xyz"], T[:3, 3], atol=1e-5)


def test_bodies_stand_in_frames_that_there_are_and_the_cut_is_drawn_once(log: Path, tmp_path: Path) -> None:
    export_to(log, "foxglove", tmp_path / "run.mcap", range_m=2e-4)
    seen = messages(tmp_path / "run.mcap")
    children = {one["child_frame_id"] for _, one in seen["/tf"]} | {"base"}
    bodies = seen["/cell"][0][1]["entities"]
    assert {one["frame_id"] for one in bodies} <= children
    assert {"foot", "stock"} <= {one["id"] for one in bodies}
    lines = [entity["lines"][0] for _, one in seen["/cut"] for entity in one["entities"]]
    way = [sum(abs(b["x"] - a["x"]) for a, b in zip(one["points"], one["points"][1:], strict=False)) for one in lines]
    assert sum(way) == pytest.approx(FEED * 0.004 * (CYCLES - 1), abs=5e-4)
    assert all(len(one["colors"]) == len(one["points"]) for one in lines)


def test_a_log_without_its_cell_has_no_bodies(tmp_path: Path) -> None:
    content = content_of(write(tmp_path / "log", rows_of()))
    assert content.scene is None
    assert set(next(iter(content.poses()))[1]) == {"commanded", "corrected"}


def test_what_cannot_be_written_is_said(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no such viewer"):
        export_to(log, "paraview", tmp_path / "x", range_m=1e-4)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match="rerun-sdk"):
        export_to(log, "rerun", tmp_path / "x.rrd", range_m=1e-4)
    with pytest.raises(InputError, match="what is to be written is not clear"):
        whole()(["log", "export", str(log), "--to", "foxglove"], standalone_mode=False)
    with pytest.raises(InputError, match="what is to be written is not clear"):
        whole()(["log", "export", str(log), "--csv", "a.csv", "--to", "foxglove", "--out", "b"], standalone_mode=False)
    assert list(tmp_path.glob("x*")) == []


def test_rerun_reads_its_file(log: Path, tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun", reason="the extra rerun is not installed")
    export_to(log, "rerun", tmp_path / "run.rrd", range_m=2e-4)
    assert (tmp_path / "run.rrd").read_bytes()[:4] == b"RRF2"
    assert rerun is not None
