"""Scenario files: strict, in layers; faults in them and in short, the same thing."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from counterflex.app.simulated_cell.scenario import schedule
from counterflex.core.errors import CounterflexError
from counterflex.files.fault_file import KINDS
from counterflex.files.scenario_file import Scenario, read_scenario, shipped
from counterflex.twin.network.faults import Fault, FaultSchedule

SCENARIO = 'format = "counterflex-scenario"\nversion = 1\n'
HEAD = 'format = "counterflex-faults"\nversion = 1\n'


def read_faults(file: Path | None, short: Iterable[str] = (), seed: int | None = None) -> FaultSchedule:
    """Faults of a file of before, and in short."""
    layers = [*([] if file is None else [str(file)]), *([] if seed is None else [f"seed={seed}"])]
    return schedule(read_scenario(layers, ()), short)


@pytest.mark.parametrize("name", sorted(shipped()))
def test_a_scenario_that_comes_along_can_be_read_by_name_and_as_a_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "mine.toml").write_text(shipped()[name], encoding="utf-8")
    found = read_scenario([name], ())
    assert found.title
    assert found != Scenario(title=found.title)  # it sets something
    assert read_scenario([str(tmp_path / "mine.toml")], ()) == found


def test_the_later_layer_wins_key_by_key(tmp_path: Path) -> None:
    file = tmp_path / "trial.toml"
    file.write_text(SCENARIO + '[rsi]\ncycle_ms = 12\nclamp_mm = 2.0\n[run]\nprogram = "part.src"\n')
    found = read_scenario([str(file), "rsi.clamp_mm=3", "seed=4", "controller.peer=127.0.0.1:4"], ("rsi", "controller"))
    assert (found.rsi.cycle_ms, found.rsi.clamp_mm, found.rsi.clamp_deg, found.seed) == (12, 3.0, 5.0, 4)
    assert found.controller.peer == "127.0.0.1:4"
    assert found.run.program == tmp_path / "part.src"  # beside the file that names it
    assert read_scenario(["rsi.clamp_mm=3", str(file)], ("rsi",)).rsi.clamp_mm == 2.0


@pytest.mark.parametrize(
    ("layer", "said"),
    [
        ("lokal", "no such scenario.*Did you mean 'local'"),
        ("rsi.cycle=4", "unknown key 'cycle'.*Write the unit into the key: cycle_ms"),
        ("rsi.cycle_ms=5", "'cycle_ms' cannot be used; got 5"),
        ("tracker.rate_hz=20", "this command reads no such key; got tracker.rate_hz; expected seed, rsi.KEY"),
        ("rsii.cycle_ms=4", "Did you mean 'rsi'"),
        ("controller.peer=localhost", "'peer' cannot be used"),
        ("rsi.clamp_mm=nan", "finite number"),
        ("rsi=4", "no such key"),
    ],
)
def test_a_layer_that_cannot_be_used_is_refused(layer: str, said: str) -> None:
    with pytest.raises(CounterflexError, match=said):
        read_scenario([layer], ("rsi", "controller") if "controller" in layer else ("rsi",))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[rsi]\ncycle_s = 0.004\n", "Its unit is another: cycle_ms"),
        ("[robot]\n", "unknown key 'robot'"),
        ("rsi = 3\n", "one table"),
        ("version = 2\n", "not valid TOML"),
    ],
)
def test_a_scenario_file_with_a_wrong_key_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "trial.toml").write_text(SCENARIO + text)
    with pytest.raises(CounterflexError, match=said):
        read_scenario([str(tmp_path / "trial.toml")], ())


def test_a_file_and_its_short_form_say_the_same(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text(
        HEAD
        + 'seed = 7\n[[faults]]\nkind = "lost"\nshare = 0.05\ndirection = "in"\n'
        + '[[faults]]\nkind = "silent"\nfrom_s = 2.0\nfor_s = 0.5\n'
        + '[[faults]]\nkind = "late"\nshare = 0.1\nlate_ms = 6.0\nfirst = 10\ncount = 5\n'
        + '[[faults]]\nkind = "status"\nbits = 0x80000001\nfrom_s = 1.0\n'
        + '[[faults]]\nkind = "offset"\noffset_mm = [0.0, 1.0, -2.0]\nfrom_s = 3.0\n'
        + '[[faults]]\nkind = "bursts"\nshare = 0.05\nmean = 3.0\n'
        + '[[faults]]\nkind = "counter"\nstep = -4000\nfrom_s = 4.0\n'
    )
    short = (
        "lost=0.05,direction=in",
        "silent@2.0+0.5",
        "late=0.1#10+5,late_ms=6",
        "status=0x80000001@1",
        "offset=0:1:-2@3",
        "bursts=0.05,mean=3",
        "counter=-4000@4",
    )
    assert read_faults(file) == read_faults(None, short, seed=7)
    assert read_faults(file, seed=9).seed == 9
    assert read_faults(file).faults[2] == Fault("late", share=0.1, late_s=0.006, first=10, count=5)
    assert read_faults(file).faults[4].offset == (0.0, 1e-3, -2e-3)
    assert read_faults(None).faults == ()
    assert read_faults(None, ["dying@3"]).faults[0] == Fault("dying", from_s=3.0, for_s=math.inf)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("lsot=0.1", "Did you mean 'lost'"),
        ("lost=1.5", "share"),
        ("lost=nan", "not a number in a fault|cannot be used"),
        ("lost=0.1,late_ms=3", "late_ms does not belong to the fault 'lost'"),
        ("lost=0.1,colour=3", "unknown key 'colour'"),
        ("lost=0.1,share=0.2", "repeated"),
        ("late=0.1", "needs the key late_ms"),
        ("bursts=0.1", "needs the key mean"),
        ("bursts=0.9,mean=2", "bursts"),
        ("silent=0.5", "share does not belong"),
        ("offset=1:2", "offset_mm"),
        ("offset=0:0:0", "not zero"),
        ("status=1@x", "not a fault"),
        ("frozen,direction=in", "direction does not belong"),
        ("", "not a fault"),
        ("dying@1+2", "for_s does not belong"),
    ],
)
def test_what_is_wrong_is_said(text: str, said: str) -> None:
    with pytest.raises(CounterflexError, match=said):
        read_faults(None, [text])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[faults]]\nkind = "lost"\nshar = 0.1\n', "Did you mean 'share'"),
        ('[[faults]]\nkind = "late"\nshare = 0.1\nlate_s = 0.1\n', "late_ms"),
        ("[[faults]]\nshare = 0.1\n", "'kind' is missing"),
        ("sed = 3\n", "unknown key 'sed'"),
        ("seed = -3\n", "seed"),
    ],
)
def test_a_file_with_a_wrong_key_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "faults.toml"
    file.write_text(HEAD + text)
    with pytest.raises(CounterflexError, match=said):
        read_faults(file)


@given(st.text(alphabet="abcdefghlostinkr=@+#,.:-0123456789", max_size=30), st.sampled_from(KINDS))
def test_any_text_is_a_fault_or_one_clear_error(text: str, kind: str) -> None:
    said, found = "", str(kind)
    try:
        found = read_faults(None, [kind + text]).faults[0].kind
    except CounterflexError as fault:
        said = str(fault)
    assert "\n" not in said
    assert found in KINDS
