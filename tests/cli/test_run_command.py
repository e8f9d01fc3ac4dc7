"""What `run` says of a loop that ended by itself, and of one that died."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import counterflex
from counterflex.app import online
from counterflex.cli.main import app

DEMO = Path(counterflex.__file__).parent / "app" / "demo"


def summary(ended: str) -> dict[str, Any]:
    return {
        "cycles": 10,
        "seconds": 0.1,
        "largest_correction_um": 0.0,
        "compute_us": {"p50": 1.0, "p99": 2.0},
        "records_lost": 0,
        "states": {"idle": 10},
        "causes": [],
        "events": [],
        "wear": None,
        "slowed_share": 0.0,
        "loop_ended": ended,
    }


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize(("ended", "status"), [(online.AS_ASKED, 0), ("died (1)", 1)])
def test_a_loop_that_died_is_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended: str, status: int, as_json: bool
) -> None:
    monkeypatch.setattr(online, "run", lambda *_, **__: summary(ended))
    words = ["run", "--cell", DEMO / "cell.toml", "--rsi", DEMO / "rsi.xml", "--out", tmp_path / "log"]
    result = CliRunner().invoke(app, [str(word) for word in [*words, *(["--json"] if as_json else [])]])
    assert result.exit_code == status, result.output
    assert ("the loop died (1)" in result.output) == bool(status)
