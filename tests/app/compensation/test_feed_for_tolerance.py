"""Feed for a tolerance: a lower feed where compensation is predicted to stay outside, and no more than that."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import Compensated, compensate
from counterflex.app.compensation.languages import write
from counterflex.app.inputs import read_job
from counterflex.core.errors import InputError
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import FEED
from counterflex.plan.feed_for_tolerance import FeedTolerance, least_share
from counterflex.plan.feed_schedule import STEP
from counterflex.plan.plan import across
from counterflex.programs.gcode.read.reader import read_gcode

ProgramFile = Callable[..., Path]
FAST = "G21 G17 G90\nM6 T1\nM3 S19500\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F2250\nG0 Z60\nM5\nM2\n"
"""At the feed of the small groove what is left hardly depends on it; at this one it does."""
HEAD = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\n"
ARC = HEAD + "G1 X20 F1500\nG3 X20 Y15 I0 J5\nG1 X52\nG0 Z60\nM2\n"


@pytest.fixture(scope="module")
def cell(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """The small cell, whose arm may swing: what is lower here is lower for the tolerance."""
    file = tmp_path_factory.mktemp("cell") / "cell.toml"
    file.write_text(small.read_text() + "\n[dynamics]\nswing_um = 0\n")
    return read_cell(file)


@pytest.fixture(scope="module")
def fast(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Compensated, Compensated]:
    """The fast groove, compensated at its feed and at one for 70 % of what that leaves."""
    file = tmp_path_factory.mktemp("fast") / "part.ngc"
    file.write_text(FAST, encoding="ascii")
    plain = compensate(file, cell)
    return file, plain, compensate(file, cell, feed=FeedTolerance(0.7 * worst(plain)))


def worst(found: Compensated) -> float:
    """Largest predicted error across the feed in the cut, m."""
    plan = found.plan
    size = np.linalg.norm(across(plan.deviation_compensated_part, plan.path.p_part_tcp), axis=1)
    return float(size[plan.judged].max())


def share(found: Compensated, programmed: Compensated) -> np.ndarray:
    out: np.ndarray = found.plan.path.feed_m_s / np.maximum(programmed.plan.path.feed_m_s, 1e-12)
    return np.where(found.plan.path.kind == FEED, out, 1.0)


def written_time(found: Compensated) -> float:
    """Time of the feed motions as a machine reads the written program, s."""
    text = next(iter(found.files.values()))
    return sum(
        float(np.linalg.norm(np.subtract(m.p_end, m.p_start))) / m.feed_m_s
        for m in read_gcode(text).motions
        if m.kind == "feed"
    )


def test_lower_feed_where_it_is_needed_pair(fast: tuple[Path, Compensated, Compensated]) -> None:
    """The same groove with and without: less error for more time, within the limits of the feed, and written so."""
    _, plain, slow = fast
    wish = FeedTolerance(0.7 * worst(plain))
    said = slow.summary["feed"]
    assert "feed" not in plain.summary
    assert worst(slow) < 0.85 * worst(plain)
    assert said["worst_before_um"] == pytest.approx(worst(plain) / UM, abs=0.1)
    assert said["worst_after_um"] == pytest.approx(worst(slow) / UM, abs=0.1)
    assert said["extra_s"] == pytest.approx(slow.plan.path.time_s[-1] - plain.plan.path.time_s[-1], abs=1e-3)
    assert said["extra_s"] > 0.0
    found = share(slow, plain)
    assert wish.least <= found.min() < 1.0
    np.testing.assert_allclose(found / STEP, np.round(found / STEP), atol=1e-6)
    time = slow.plan.path.time_s
    p = slow.plan.path.p_part_tcp
    moves = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1) > 0.0  # a stop that planning puts in has no feed
    feed = np.flatnonzero((slow.plan.path.kind == FEED) & moves)
    for a, b in itertools.pairwise(feed):
        if b == a + 1:
            assert abs(found[b] - found[a]) <= wish.change_per_s * (time[b] - time[a - 1]) + STEP + 1e-9
    longer = written_time(slow) - written_time(plain)
    assert longer == pytest.approx(said["extra_s"], rel=0.1)
    for line in said["lines"]:
        mine = slow.plan.line == line["line"]
        assert line["feed_percent"] == pytest.approx(100.0 * found[mine].min(), abs=0.06)
        for key, run in (("before_um", plain), ("after_um", slow)):
            error = np.linalg.norm(across(run.plan.deviation_compensated_part, run.plan.path.p_part_tcp), axis=1)
            assert line[key] == pytest.approx(error[mine & run.plan.judged].max() / UM, abs=0.06)


def test_robot_programs_carry_the_lower_speed(cell: Cell, fast: tuple[Path, Compensated, Compensated]) -> None:
    file, plain, slow = fast
    job = read_job(file, cell)
    for language, pattern in (("krl", r"\$VEL\.CP=([0-9.]+)"), ("rapid", r"speeddata \w+:=\[([0-9.]+)")):
        texts = [write(job, found.plan, cell, language)[0].values() for found in (slow, plain)]
        lowest = [min(float(v) for text in files for v in re.findall(pattern, text)) for files in texts]
        least = min(line["feed_percent"] for line in slow.summary["feed"]["lines"]) / 100.0
        assert lowest[0] < 0.9 * lowest[1]
        assert lowest[0] > 0.7 * least * lowest[1]


def test_where_the_tolerance_holds_nothing_changes(cell: Cell, program: ProgramFile) -> None:
    file = program()
    plain = compensate(file, cell)
    same = compensate(file, cell, feed=FeedTolerance(1.01 * worst(plain)))
    assert same.files == plain.files
    assert same.summary["feed"]["lines"] == []
    assert same.summary["feed"]["extra_s"] == 0.0
    assert same.summary["feed"]["reached"]


def test_what_cannot_be_reached_is_said_line_by_line(cell: Cell, program: ProgramFile) -> None:
    file = program()
    plain = compensate(file, cell)
    chip = compensate(file, cell, feed=FeedTolerance(5.0 * UM, least_chip_m=1000.0 * UM))
    assert {line["why"] for line in chip.summary["feed"]["lines"]} == {"least chip"}
    assert chip.files == plain.files
    floor = compensate(file, cell, feed=FeedTolerance(5.0 * UM, least=0.9))
    assert share(floor, plain).min() >= 0.9 - 1e-9
    whys = {line["why"] for line in floor.summary["feed"]["lines"] if line["after_um"] > 5.0}
    assert whys <= {"least feed", "no gain"}
    assert whys
    assert not floor.summary["feed"]["reached"]


def test_what_is_cut_again_keeps_the_least_chip(cell: Cell, program: ProgramFile) -> None:
    """A row behind the cut has no chip of its own: a feed lowered there would rub where the cut beside it may not."""
    plan = compensate(program(), cell).plan
    again = plan.judged & ~plan.cutting
    assert again.any()
    free = FeedTolerance(5.0 * UM, least_chip_m=0.0)
    held = FeedTolerance(5.0 * UM, least_chip_m=1000.0 * UM)
    np.testing.assert_allclose(least_share(plan, free)[0][again], free.least)
    least, by_chip = least_share(plan, held)
    assert np.all(least[again] == 1.0)
    assert np.all(by_chip[again])


@pytest.mark.long
def test_an_arc_keeps_one_feed(cell: Cell, program: ProgramFile) -> None:
    file = program(ARC)
    plain = compensate(file, cell)
    slow = compensate(file, cell, feed=FeedTolerance(0.3 * worst(plain)))
    arc = plain.plan.line == 8
    found = share(slow, plain)
    assert len(np.unique(np.round(found[arc & (plain.plan.path.kind == FEED)], 6))) == 1
    assert written_time(slow) >= written_time(plain)


def test_inverse_time_feeds_are_left_alone(cell: Cell, program: ProgramFile) -> None:
    """G93: F is one by the time of the block; the command says that it does not change it."""
    file = program(HEAD + "G93\nG1 X52 F23.4\nG94\nG0 Z60\nM2\n")
    plain = compensate(file, cell)
    fixed = compensate(file, cell, feed=FeedTolerance(0.5 * worst(plain)))
    assert fixed.files == plain.files
    assert [line["why"] for line in fixed.summary["feed"]["lines"]] == ["fixed feed"]


def test_bad_wishes_are_refused(cell: Cell, program: ProgramFile) -> None:
    with pytest.raises(InputError, match="prediction"):
        compensate(program(), cell, feed=FeedTolerance(50.0 * UM), predict=False)
    for bad in ({"tolerance_m": 0.0}, {"tolerance_m": 1e-5, "least": 0.01}, {"tolerance_m": 1e-5, "least": 1.5}):
        with pytest.raises(InputError, match="feed"):
            FeedTolerance(**bad)
