"""The progress of a job from that of its parts."""

from __future__ import annotations

import pytest

from counterflex.core.progress import in_parts


def test_parts_follow_each_other_by_their_work() -> None:
    seen: list[tuple[float, str]] = []

    def told(fraction: float, what: str = "") -> None:
        seen.append((fraction, what))

    parts = in_parts(told, {"reading": 1.0, "cutting": 7.0, "writing": 2.0})
    parts["reading"](0.0)
    parts["reading"](1.0)
    parts["cutting"](0.5, "half way")
    parts["writing"](0.0)
    parts["writing"](1.0)
    assert [fraction for fraction, _ in seen] == pytest.approx([0.0, 0.1, 0.45, 0.8, 1.0], abs=1e-12)
    assert [what for _, what in seen] == ["reading", "reading", "half way", "writing", "writing"]
    assert seen[-1][0] == 1.0


def test_a_part_can_have_parts() -> None:
    seen: list[float] = []

    def told(fraction: float, what: str = "") -> None:
        seen.append(fraction)

    inner = in_parts(in_parts(told, {"first": 1.0, "second": 3.0})["second"], {"a": 1.0, "b": 1.0})
    inner["a"](1.0)
    inner["b"](1.0)
    assert seen == pytest.approx([0.625, 1.0], abs=1e-12)
