"""The simulated cell sends the force as the cell file's sensor speaks, and the loop's side opens the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.run.session import RunSettings, _opening
from counterflex.app.simulated_cell.cell import LiveSettings
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.integrations.ati.simulated import NetftServer
from counterflex.protocols.force.sensors import opened
from counterflex.twin.network.faults import Fault

TEXT = (Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
WRENCH = '\n[sensor]\nsegment = "sensor"\nprotocol = "wrench"\n[sensor.link]\nsource = 7\n'
FRAME = """
[sensor]
segment = "sensor"
protocol = "frame"
[sensor.frame]
header = "55aa"
byte_order = "big"
fields = ["uint16 sequence", "uint8 status", "int32 fx", "int32 fy", "int32 fz", "int32 mx", "int32 my", "int32 mz"]
counts_per_n = 1000
counts_per_nm = 10000
saturated_bits = 1
invalid_bits = 2
"""
W = np.array([10.0, -20.0, 30.0, 1.0, -2.0, 3.0])


def cell_of(folder: Path, sensor: str) -> Cell:
    file = folder / "cell.toml"
    file.write_text(TEXT + sensor, encoding="utf-8")
    return read_cell(file)


def settings(port: int | None, *faults: Fault) -> LiveSettings:
    none = Path("none")
    return LiveSettings(none, none, none, force_port=port, force_faults=faults)


@pytest.mark.parametrize("sensor", [WRENCH, FRAME])
def test_both_sides_speak_what_the_cell_file_names(tmp_path: Path, sensor: str) -> None:
    cell = cell_of(tmp_path, sensor)
    table = cell.tables.sensor
    assert table is not None
    link = opened(table.protocol, _opening(RunSettings(tmp_path / "cell.toml"), ("127.0.0.1", 0), table))
    port = link.address[1]  # type: ignore[attr-defined]
    device = settings(port, Fault("nan", first=4, count=1), Fault("saturated", first=6, count=1))._device(cell)
    assert device is not None
    for k in range(6):
        device.send(W, 1e-3 * k)
    assert link.drain() == 5
    np.testing.assert_allclose(link.w_sensor, W, atol=1e-3)
    assert not link.saturated
    device.send(W, 6e-3)
    assert link.drain() == 0
    assert link.saturated
    device.close()
    link.close()


def test_other_sensors_are_a_net_ft_and_what_cannot_be_shown_is_refused(tmp_path: Path) -> None:
    plain = settings(0)._device(cell_of(tmp_path, ""))
    assert isinstance(plain, NetftServer)
    plain.close()
    assert settings(None)._device(cell_of(tmp_path, WRENCH)) is None
    with pytest.raises(InputError, match=r"where the force sensor sends to is not said.*force_sensor\.address"):
        settings(0)._device(cell_of(tmp_path, WRENCH))
    for line in ('transport = "tcp"', 'start = "01"', 'request = "01"'):
        asked = FRAME.replace("[sensor.frame]\n", f"[sensor.frame]\n{line}\n")
        with pytest.raises(InputError, match="sends frames by itself over UDP only"):
            settings(49300)._device(cell_of(tmp_path, asked))
