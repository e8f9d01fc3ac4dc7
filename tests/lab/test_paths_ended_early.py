"""A run of ``reproduce paths`` that ended early is named with its cause, and not stored as a result."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import OutputError
from counterflex_lab.reproduce import closed_loop, mandiola, mandiola_case


@pytest.mark.parametrize("share", [0.3, 0.89])
def test_a_run_that_ended_early_is_an_error_and_leaves_its_log(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = mandiola_case.write_case(tmp_path / "seed-1", 1, scale=mandiola.QUICK_SCALE)
    path = SimpleNamespace(path=SimpleNamespace(time_s=np.array([0.0, 23.0])))
    expected = round(23.0 / mandiola_case.PERIOD_S) + 250

    def run(twin: Any, part: Path, loop: Any, log: Path, **_: Any) -> dict[str, Any]:
        log.mkdir()
        return {"cycles": int(share * expected), "causes": ["off_path"], "states": {}}

    monkeypatch.setattr(mandiola, "prepare", lambda *_: None)
    monkeypatch.setattr(mandiola, "read_plan", lambda _: (path, {}))
    monkeypatch.setattr(closed_loop, "run", run)
    with pytest.raises(OutputError, match=r"square ended early.*off_path"):
        mandiola.one(case, "square", "published")
    part = case.folder / "square-published"
    assert (part.with_name("square-published-log")).is_dir()
    assert not (part / "done.json").exists()
