"""The simulated controller's side of RSI: what it accepts, holds, clamps and stops at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.kernel import OK
from counterflex.integrations.kuka.link.telegram import answer_writer, robot_reader
from counterflex.integrations.kuka.simulated import CLAMPED, CORRECTING, FREE, FakeRsi, RsiContext
from counterflex.twin.devices.commanded_motion import Report
from counterflex.twin.plant.drives import DATA_SHEET_NM_A, RIPPLE_A, SHARE, MotorCurrents

CONFIG = (
    "<ROOT><CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>49152</PORT><SENTYPE>Counterflex</SENTYPE></CONFIG>"
    "<SEND><ELEMENTS>"
    + "".join(f'<ELEMENT TAG="DEF_{t}" TYPE="DOUBLE" INDX="INTERNAL"/>' for t in ("RIst", "RSol", "AIPos", "ASPos"))
    + '<ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/><ELEMENT TAG="Corr.Stat" TYPE="LONG" INDX="1"/>'
    + '<ELEMENT TAG="Enable" TYPE="BOOL" INDX="2"/></ELEMENTS></SEND><RECEIVE><ELEMENTS>'
    + "".join(
        f'<ELEMENT TAG="RKorr.{a}" TYPE="DOUBLE" INDX="{i}" HOLDON="HOLD"/>' for i, a in enumerate("XYZABC", start=1)
    )
    + '<ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="1"/><ELEMENT TAG="Override" TYPE="DOUBLE" INDX="8"/>'
    + "</ELEMENTS></RECEIVE></ROOT>"
)
Q = np.array([0.1, -1.5, 1.6, 0.2, 0.3, -0.4])
T = pose.make(rotation.from_zyx(np.array([0.1, 0.2, 3.0])), np.array([0.1, -0.2, 0.04]))
REPORT = Report(0.0, T, T @ pose.make(p=np.array([1e-4, 0.0, 0.0])), Q, Q + 1e-4, True, False)


def session(hold: int = 1, **context: object) -> FakeRsi:
    config = parse_config(CONFIG.replace('"HOLD"', f'"{hold}"').encode(), "x")
    return FakeRsi(config, RsiContext(**context), {"Enable": 1.0})  # type: ignore[arg-type]


def cycle(fake: FakeRsi, x_mm: float | None, *, counter: int | None = None, sentype: str = "Counterflex") -> None:
    fake.telegram(REPORT)
    if x_mm is None:
        fake.answer(None)
        return
    writer = answer_writer(replace(fake.config, sentype=sentype))
    writer.values[writer.place("RKorr.X")] = x_mm
    writer.values[writer.place("Override")] = 100.0
    fake.answer(writer.telegram(fake.counter if counter is None else counter))


def test_telegrams_say_where_the_robot_is() -> None:
    fake, reader = session(), robot_reader(session().config)
    assert reader.read_bytes(fake.telegram(REPORT)) == OK
    named = dict(zip(reader.names, reader.values, strict=True))
    assert named["RSol.X"] == pytest.approx(100.0, abs=5e-5)
    assert named["RSol.B"] == pytest.approx(np.degrees(0.2), abs=5e-5)
    assert named["AIPos.A2"] == pytest.approx(np.degrees(-1.4999), abs=5e-5)
    assert named["ASPos.A6"] == pytest.approx(np.degrees(-0.4), abs=5e-5)
    assert named["Enable"] == 1.0
    first = reader.counter
    assert reader.read_bytes(fake.telegram(REPORT)) == OK
    assert reader.counter == first + 4


def test_motor_currents_are_the_drives_torques_by_constants_near_the_data_sheets() -> None:
    text = (
        CONFIG.replace('"HOLD"', '"1"')
        .replace("DEF_Delay", "DEF_MACur")
        .replace('"LONG" INDX="INTERNAL"', '"DOUBLE" INDX="INTERNAL"')
    )
    config = parse_config(text.encode(), "x")
    fake, reader = FakeRsi(config, RsiContext(), currents=MotorCurrents(3)), robot_reader(config)
    torque = np.array([900.0, -2500.0, 1800.0, -60.0, 400.0, 120.0])
    shown = []
    for _ in range(400):
        assert reader.read_bytes(fake.telegram(replace(REPORT, drive_torque=torque))) == OK
        shown.append(reader.values[reader.place(*(f"MACur.A{i}" for i in range(1, 7)))])
    ratio = np.mean(shown, axis=0) * np.array(DATA_SHEET_NM_A) / torque
    assert np.all(np.abs(ratio - 1.0) < 4.0 * SHARE)
    assert np.all(ratio != 1.0)
    assert np.std(shown, axis=0) == pytest.approx(RIPPLE_A, rel=0.2)
    silent = FakeRsi(config, RsiContext())
    reader.read_bytes(silent.telegram(replace(REPORT, drive_torque=torque)))
    assert reader.values[reader.place("MACur.A2")] == 0.0


def test_a_program_says_its_job_where_enable_is_a_number() -> None:
    told = {}
    for kind in ("DOUBLE", "LONG", "BOOL"):
        text = CONFIG.replace('"HOLD"', '"1"').replace('"Enable" TYPE="BOOL"', f'"Enable" TYPE="{kind}"')
        config = parse_config(text.encode(), "x")
        fake, reader = FakeRsi(config, RsiContext(), job=4711), robot_reader(config)
        for on in (False, True):
            fake.enabled = on
            assert fake.enabled == on
            reader.read_bytes(fake.telegram(REPORT))
            told[kind, on] = reader.values[reader.place("Enable")][0]
    assert told == {
        ("DOUBLE", False): 0.0, ("DOUBLE", True): 4711.0, ("LONG", False): 0.0, ("LONG", True): 4711.0,
        ("BOOL", False): 0.0, ("BOOL", True): 1.0,
    }  # fmt: skip


def test_precision_rounds_what_is_sent() -> None:
    fake, reader = session(precision=1), robot_reader(session().config)
    reader.read_bytes(fake.telegram(REPORT))
    assert reader.values[reader.place("RIst.X")][0] == pytest.approx(
        round(float((REPORT.T_part_actual)[0, 3] * 1e3), 1)
    )


@pytest.mark.parametrize(("hold", "left"), [(1, 0.3), (0, 0.0)])
def test_absolute_a_lost_answer_keeps_or_drops_the_correction(hold: int, left: float) -> None:
    fake = session(hold)
    cycle(fake, 0.3)
    assert fake.correction[0] == pytest.approx(0.3e-3)
    cycle(fake, None)
    assert fake.correction[0] == pytest.approx(left * 1e-3)
    assert fake.late == 1


@pytest.mark.parametrize(("hold", "total"), [(1, 100), (0, 90)])
def test_relative_with_holdon_applies_the_last_increment_again(hold: int, total: int) -> None:
    fake = session(hold, mode="relative", timeout=100)
    for k in range(100):
        cycle(fake, None if k % 10 == 9 else 0.001)
    assert fake.correction[0] == pytest.approx(total * 1e-6)


def test_clamps_in_silence_and_says_so_in_its_status_only() -> None:
    fake = session()
    cycle(fake, 0.0)
    assert fake.stat == FREE
    cycle(fake, 4.0)
    assert fake.stat == CORRECTING
    cycle(fake, 5.5)
    assert fake.stat == CLAMPED
    assert fake.correction[0] == pytest.approx(5e-3)
    assert not fake.stopped


def test_the_monitor_stops() -> None:
    fake = session(clamp_m=10e-3)
    cycle(fake, 6.5)
    assert fake.stopped == "POSCORRMON"


@pytest.mark.parametrize(
    ("said", "kwargs"), [("IPOC", {"counter": 17}), ("SENTYPE", {"sentype": "KROSHU"}), ("no answer", {})]
)
def test_wrong_answers_count_as_late_and_stop_at_the_timeout(said: str, kwargs: dict[str, object]) -> None:
    fake = session(timeout=10)
    cycle(fake, 0.2)
    for k in range(10):
        assert fake.stopped == ""
        cycle(fake, None if said == "no answer" else 0.4, **kwargs)  # type: ignore[arg-type]
        assert fake.refused == said
        assert fake.late == k + 1
    assert fake.stopped == "RSITimeout"
    assert fake.correction[0] == pytest.approx(0.2e-3)


def test_first_telegram_of_a_kr_c2_holds_its_counter_only() -> None:
    fake = session(empty_first=True)
    assert b"RIst" not in fake.telegram(REPORT)
    assert b"RIst" in fake.telegram(REPORT)


def test_a_garbled_answer_is_refused() -> None:
    fake = session()
    fake.telegram(REPORT)
    fake.answer(b'<Sen Type="Counterflex"><RKorr X="nan"/></Sen>')
    assert fake.refused == "unreadable"


def test_settings_are_checked() -> None:
    with pytest.raises(InputError):
        RsiContext(cycle_s=5e-3)
    with pytest.raises(InputError):
        RsiContext(mode="sideways")  # type: ignore[arg-type]
