"""Strains of the simulated holder over both of its ways: datagrams, and a TwinCAT whose terminals are forwarded."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.fault_file import short_fault
from counterflex.integrations.beckhoff import jobs as job
from counterflex.integrations.beckhoff.alone import terminals
from counterflex.protocols.strain.link import StrainLink
from counterflex.twin.devices.strain import StrainSender
from counterflex.twin.network.faults import FaultSchedule
from counterflex_lab.reproduce import holder_case

ADS = """
[ads]
net_id = "127.0.0.9.1.1"
host = "HOST"
timeout_ms = 2000
period_ms = 1
strain = ["GVL.s1", "GVL.s2", "GVL.s3", "GVL.s4", "GVL.s5", "GVL.s6"]
strain_time = "GVL.stamp"
strain_temperature = "GVL.warm"
"""


@pytest.fixture
def cell(tmp_path: Path) -> Cell:
    file = holder_case.catalogue_cell(tmp_path)
    host = f"127.{random.randrange(1, 255)}.{random.randrange(1, 255)}.{random.randrange(2, 255)}"  # one port only
    file.write_text(file.read_text(encoding="utf-8") + ADS.replace("HOST", host), encoding="utf-8")
    return read_cell(file)


def sender(link: StrainLink | None, *faults: str) -> StrainSender:
    schedule = FaultSchedule(tuple(short_fault(text).fault() for text in faults))
    return StrainSender(None if link is None else link.address, 6, schedule)


def strain_at(k: int) -> Float:
    """Six strains of a reading, no two alike."""
    out: Float = 1e-6 * (np.arange(1.0, 7.0) + 0.01 * k)
    return out


class Turning(StrainSender):
    """Amplifiers that take their next reading once each was read twice: temperature is read last."""

    reads = 0

    @property
    def temperature_c(self) -> float:
        """23.5 deg C."""
        self.reads += 1
        if self.reads % 2 == 0:
            k = self.reads // 2
            self.send(strain_at(k), 23.5, 0.001 * (k + 1))
        return 23.5

    @temperature_c.setter
    def temperature_c(self, _: float) -> None: ...


def test_terminals_are_forwarded_as_datagrams_each_reading_once(cell: Cell) -> None:
    """What the amplifiers show arrives with their own time; what is read twice is sent once."""
    link = StrainLink("127.0.0.1", 0, 6, range_=1e-3)
    amplifiers = Turning(None, 6)
    amplifiers.send(strain_at(0), 23.5, 0.001)
    plc = terminals(cell, amplifiers, (cell.tables.ads.host if cell.tables.ads else "", 48898))
    try:
        done = job.forward(cell.path, link.address, readings=20, strain=True)
        count = link.drain()
    finally:
        plc.close()
        link.close()
        amplifiers.close()
    assert done["sent"] == count == 20
    stamps = link.times_ns[:20]
    assert np.all(np.diff(stamps) == 1_000_000)
    for stamp, strain in zip(stamps, link.strain[:20, :6], strict=True):
        np.testing.assert_allclose(strain, strain_at(int(stamp) // 1_000_000 - 1), rtol=1e-9)
    np.testing.assert_allclose(link.warm_c[:20], 23.5)


def test_faults_of_one_bridge_and_of_all() -> None:
    link = StrainLink("127.0.0.1", 0, 6, range_=1e-3)
    amplifiers = sender(
        link,
        "nan@0.1+0.1,bridge=2",
        "saturated@0.2+0.1,bridge=3",
        "offset@0.3+0.1,bridge=4,offset_um_m=30",
        "frozen@0.4+0.1,bridge=5",
        "silent@0.5+0.1",
    )
    shown = []
    for k in range(61):
        amplifiers.send(strain_at(k), 22.0, 0.01 * k)
        count = link.drain()
        shown.append(link.strain[0, :6] - strain_at(k) if count else np.full(6, np.inf))
    amplifiers.close()
    link.close()
    off = np.array(shown)
    np.testing.assert_allclose(off[:10], 0.0, atol=1e-12)
    assert np.all(np.isnan(off[10:20, 1]))
    assert np.all(np.isnan(off[20:30, 2]))
    np.testing.assert_allclose(off[30:40, 3], 30e-6, rtol=1e-9)
    np.testing.assert_allclose(off[40:50, 4], -1e-8 * np.arange(1, 11), atol=1e-12)
    assert np.all(np.isinf(off[50:60]))
    assert np.all(off[60] == off[0])


def test_what_does_not_belong_is_refused(cell: Cell, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not have the bridge"):
        sender(None, "nan,bridge=7")
    with pytest.raises(InputError, match="hits all bridges|does not belong"):
        sender(None, "silent,bridge=2")
    fewer = StrainSender(None, 5)
    with pytest.raises(InputError, match="strain terminals and bridges"):
        terminals(cell, fewer, ("127.0.0.1", 0))
    fewer.close()
    other = tmp_path / "other.toml"
    text = cell.path.read_text(encoding="utf-8").replace(', "GVL.s6"', "")
    other.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match="strain terminals and bridges"):
        job.forward(other, ("127.0.0.1", 9), readings=1, strain=True)
