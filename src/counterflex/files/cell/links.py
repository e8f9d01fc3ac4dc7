"""Table ``[ads]`` of a cell file: a TwinCAT, and what its symbols are."""

from __future__ import annotations

import re
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from counterflex.core.errors import InputError
from counterflex.core.similar import twice
from counterflex.files.cell.online import OnlineTable
from counterflex.files.dataset.units import UNITS, plain
from counterflex.files.schema import Table

Above = Annotated[float, Field(gt=0.0, le=1e6)]
PATH_MS = 24
GUIDANCE_MS = 4


class EgmTable(Table):
    """Way of EGM that is used, and its settings on the controller."""

    mode: Literal["path", "pose"] = "path"
    port: Annotated[int, Field(ge=1, le=65535)] = 6510
    device: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_:]{0,31}$")] = "UCdevice"
    configuration: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")] | None = None
    frame: Literal["part", "base"] = "part"
    timeout_ms: Annotated[float, Field(ge=8.0, le=100.0)] = 100.0
    position_gain_per_s: Annotated[float, Field(gt=0.0, le=20.0)] = 20.0
    low_pass_hz: Annotated[float, Field(ge=0.0, le=100.0)] = 20.0
    speed_deviation_deg_s: Annotated[float, Field(gt=0.0, le=180.0)] = 20.0
    ramp_in_ms: Annotated[float, Field(ge=0.0, le=5000.0)] = 100.0
    window_mm: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05
    window_deg: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05
    standing_s: Annotated[float, Field(ge=5.0, le=600.0)] = 30.0
    start_tolerance_mm: Annotated[float, Field(gt=0.0, le=10.0)] = 1.0
    start_tolerance_deg: Annotated[float, Field(gt=0.0, le=10.0)] = 0.5
    follow_mm: Annotated[float, Field(gt=0.0, le=20.0)] = 2.0
    acceleration_mm_s2: Above = 500.0
    blending_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.2
    speed_reference: bool = False

    @property
    def configuration_name(self) -> str:
        """Name of the External Motion Interface Data: ``pathCorr`` or ``default`` where none is given."""
        return self.configuration or ("pathCorr" if self.mode == "path" else "default")

    def require(self, online: OnlineTable, where: str) -> None:
        """Check that EGM can do what the table ``[online]`` wants. Raises InputError: it cannot."""
        pose, period = self.mode == "pose", f"period_ms = {online.period_ms}"
        requirements = (  # broken, what, value, limit, what to do
            (online.output == "axes", "EGM takes no axis corrections", 'output = "axes"', "cartesian",
             'Set output = "cartesian"'),
            (pose and online.period_ms != GUIDANCE_MS, "guidance runs in another cycle", online.period_ms, GUIDANCE_MS,
             "Set [online] period_ms = 4"),
            (not pose and online.period_ms % PATH_MS, "path correction runs in another cycle", period,
             f"multiples of {PATH_MS} ms", "Set [online] period_ms = 24"),
            (not pose and (online.orientation or online.along_feed),
             "path correction moves square to the path only, without turning", "orientation or along_feed = true",
             "false", 'Set both to false, or [egm] mode = "pose"'),
        )  # fmt: skip
        for broken, what, value, limit, hint in requirements:
            if broken:
                raise InputError(what, where=where, value=value, limit=limit, hint=hint)


Symbol = Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[A-Za-z_][A-Za-z0-9_.\[\],]*$")]
_NET_ID: Final = re.compile(r"[0-9]{1,3}(\.[0-9]{1,3}){5}")
STRAIN: Final = "strain"
"""Names of the strain terminals here: ``strain1`` to ``strain12``."""
HOLDER_TIME, HOLDER_TEMPERATURE = "holder_time", "holder_temperature"
"""Names of the time of their reading, ns of the PLC's clock, and of the temperature of the holder, deg C."""


def si_of(unit: str) -> tuple[str, float]:
    """SI unit of a unit, and the SI value of one of it. Raises ValueError: the unit is not known."""
    requested = plain(unit)
    for si, units in UNITS.items():
        if requested in units:
            return si, units[requested]
    raise ValueError(
        f"the unit '{unit}' is not known; expected one of {', '.join(u for us in UNITS.values() for u in us)}"
    )


def _of(unit: str, allowed: tuple[str, ...], what: str) -> None:
    si, _ = si_of(unit)
    if si not in allowed:
        raise ValueError(f"{what} is no unit of {' or '.join(allowed)}: '{unit}'")


class AdsTrackerTable(Table):
    """Symbols of a laser tracker: spherical coordinates and a quaternion (Mandiola2023 eq. 1)."""

    distance: Symbol
    azimuth: Symbol
    zenith: Symbol
    qw: Symbol | None = None
    qx: Symbol | None = None
    qy: Symbol | None = None
    qz: Symbol | None = None
    beam_ok: Symbol | None = None
    length_unit: str = "mm"
    angle_unit: str = "rad"

    @model_validator(mode="after")
    def _whole(self) -> Self:
        present = [value is not None for value in (self.qw, self.qx, self.qy, self.qz)]
        if any(present) and not all(present):
            raise ValueError("qw, qx, qy and qz belong together; give all or none")
        _of(self.length_unit, ("m",), "length_unit")
        _of(self.angle_unit, ("rad",), "angle_unit")
        return self


class AdsParameterTable(Table):
    """One number in the PLC, by a name of the user's."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    symbol: Symbol
    unit: str = "1"
    write: bool = False
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _range(self) -> Self:
        si_of(self.unit)
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is not below high: {self.low:g}, {self.high:g}")
        if self.name.startswith((STRAIN, "tracker_", "holder_")):
            raise ValueError(f"the name '{self.name}' is taken by strain terminals or tracker")
        return self


class AdsTable(Table):
    """Address of a TwinCAT and its symbols."""

    net_id: str
    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 851
    local_net_id: str = ""
    timeout_ms: Annotated[float, Field(ge=1.0, le=60000.0)] = 1000.0
    period_ms: Annotated[float, Field(ge=1.0, le=60000.0)] = 10.0
    strain: Annotated[tuple[Symbol, ...], Field(max_length=12)] = ()
    strain_unit: str = "um/m"
    strain_time: Symbol | None = None
    strain_temperature: Symbol | None = None
    tracker: AdsTrackerTable | None = None
    parameters: tuple[AdsParameterTable, ...] = ()

    @model_validator(mode="after")
    def _belong(self) -> Self:
        for net_id in filter(None, (self.net_id or "?", self.local_net_id)):
            if not _NET_ID.fullmatch(net_id) or max(map(int, net_id.split("."))) > 255:
                raise ValueError(f"not an AMS net id: {net_id!r}; expected six numbers up to 255: 192.168.1.20.1.1")
        _of(self.strain_unit, ("1", "V/V"), "strain_unit")
        if (name := twice([one.name for one in self.parameters])) is not None:
            raise ValueError(f"two parameters are named '{name}'")
        return self

    @property
    def in_volts(self) -> bool:
        """The strain terminals show the bridges' signal, not strain."""
        return si_of(self.strain_unit)[0] == "V/V"
