"""Table ``[ads]`` of a cell file: a TwinCAT, and what its symbols are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, Self

from pydantic import Field, model_validator

from counterflex.core.errors import ProtocolError
from counterflex.core.units import MS
from counterflex.files.dataset.units import UNITS, plain
from counterflex.files.schema import Table
from counterflex.protocols.ads.telegram import PLC_PORT, net_id_bytes

if TYPE_CHECKING:
    from counterflex.protocols.ads.link import AdsSettings, AdsSymbol

Symbol = Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[A-Za-z_][A-Za-z0-9_.\[\],]*$")]
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

    def symbols(self) -> tuple[AdsSymbol, ...]:
        """Their symbols, named ``tracker_distance`` and so on."""
        from counterflex.protocols.ads.link import AdsSymbol

        length, angle = si_of(self.length_unit)[1], si_of(self.angle_unit)[1]
        units = {"distance": length, "azimuth": angle, "zenith": angle}
        names = ("distance", "azimuth", "zenith", "qw", "qx", "qy", "qz", "beam_ok")
        return tuple(
            AdsSymbol(f"tracker_{name}", symbol, units.get(name, 1.0))
            for name in names
            if (symbol := getattr(self, name)) is not None
        )


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

    def as_symbol(self) -> AdsSymbol:
        """In SI."""
        from counterflex.protocols.ads.link import AdsSymbol

        si = si_of(self.unit)[1]
        low = -math.inf if self.low is None else self.low * si
        high = math.inf if self.high is None else self.high * si
        return AdsSymbol(self.name, self.symbol, si, self.write, low, high)


class AdsTable(Table):
    """Where a TwinCAT is and which of its symbols are what."""

    net_id: str
    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = PLC_PORT
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
            try:
                net_id_bytes(net_id)
            except ProtocolError as fault:
                raise ValueError(f"{fault.what}: {net_id!r}; expected {fault.limit}") from fault
        _of(self.strain_unit, ("1", "V/V"), "strain_unit")
        names = [one.name for one in self.parameters]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"two parameters are named '{twice}'")
        return self

    def settings(self) -> AdsSettings:
        """Where the TwinCAT is."""
        from counterflex.protocols.ads.link import AdsSettings

        return AdsSettings(self.net_id, self.host, self.port, self.local_net_id, self.timeout_ms * MS)

    def symbols(self) -> tuple[AdsSymbol, ...]:
        """All: terminals ``strain1`` ..., their time and temperature, tracker ``tracker_...``, parameters by names."""
        from counterflex.protocols.ads.link import AdsSymbol

        si = si_of(self.strain_unit)[1]
        strain = tuple(AdsSymbol(f"{STRAIN}{k}", symbol, si) for k, symbol in enumerate(self.strain, start=1))
        readings = ((HOLDER_TIME, self.strain_time), (HOLDER_TEMPERATURE, self.strain_temperature))
        strain += tuple(AdsSymbol(name, symbol, 1.0) for name, symbol in readings if symbol is not None)
        tracker = () if self.tracker is None else self.tracker.symbols()
        return (*strain, *tracker, *(one.as_symbol() for one in self.parameters))

    @property
    def in_volts(self) -> bool:
        """The strain terminals show the bridges' signal, not strain."""
        return si_of(self.strain_unit)[0] == "V/V"
