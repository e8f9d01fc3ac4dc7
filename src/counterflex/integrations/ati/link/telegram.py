"""ATI Net F/T: requests, records and the scaling document of the Raw Data Transfer protocol (UDP, big-endian).

A record holds what the sensor shows; whether that is the load on the tool or its reaction is the mounting's matter.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from counterflex.core.errors import ProtocolError
from counterflex.core.units import KGF, LBF, MM

Three = tuple[float, float, float]

PORT: Final = 49152
HEADER: Final = 0x1234
STOP: Final = 0x0000
START: Final = 0x0002
"""Stream records in real time until told to stop."""
SET_BIAS: Final = 0x0042
RECORD: Final = struct.Struct(">III6i")
RAIL: Final = 2**31 - 1
"""Largest count of a record: what reaches it is no reading."""
_REQUEST: Final = struct.Struct(">HHI")
GOOD: Final = 0
MONITOR: Final = 0x80010000
"""Status of a record in which a threshold of the sensor's own monitor was crossed: a warning, the values hold."""


_POUND_INCH: Final = LBF * 25.4 * MM
_NEWTON: Final = {
    "n": 1.0,
    "kn": 1e3,
    "lbf": LBF,
    "lb": LBF,
    "klbf": 1e3 * LBF,
    "kg": KGF,
    "kgf": KGF,
}
_METRE: Final = {"m": 1.0, "mm": MM, "cm": 10.0 * MM, "in": 25.4 * MM, "ft": 12.0 * 25.4 * MM}
_NEWTON_METRE: Final = {
    "nm": 1.0,
    "nmm": MM,
    "knm": 1e3,
    "lbfin": _POUND_INCH,
    "inlb": _POUND_INCH,
    "lbin": _POUND_INCH,
    "lbfft": 12.0 * _POUND_INCH,
    "ftlb": 12.0 * _POUND_INCH,
    "kgcm": 10.0 * KGF * MM,
    "kgfcm": 10.0 * KGF * MM,
}


def request(command: int, samples: int = 0) -> bytes:
    """A request of 8 bytes; ``samples`` 0 streams without end.

    Raises:
        ProtocolError: A number does not fit its field.
    """
    if not (0 <= command <= 0xFFFF and 0 <= samples <= 0xFFFFFFFF):
        raise ProtocolError("request of a force sensor out of range", value=(command, samples))
    return _REQUEST.pack(HEADER, command, samples)


def read_request(data: bytes) -> tuple[int, int]:
    """Command and sample count of a request: the sensor's side. Raises ProtocolError: not a request."""
    if len(data) != _REQUEST.size:
        raise ProtocolError("not a request of a force sensor", value=f"{len(data)} bytes", limit=_REQUEST.size)
    header, command, samples = _REQUEST.unpack(data)
    if header != HEADER:
        raise ProtocolError("not a request of a force sensor", value=f"0x{header:04x}", limit=f"0x{HEADER:04x}")
    return command, samples


@dataclass(frozen=True)
class Scaling:
    """Counts of a sensor in SI."""

    force_n: float  # N per count
    moment_nm: float  # N m per count
    rate_hz: float | None = None  # Records per second that the sensor is set to; None where it does not say
    product: str = ""  # Its name; empty where it does not say
    range_n: Three = (math.inf,) * 3  # (3,) N that it is calibrated for, by axis; infinite where it does not say
    range_nm: Three = (math.inf,) * 3  # (3,) N m, likewise

    @classmethod
    def of(cls, document: bytes, where: str = "netftapi2.xml") -> Scaling:
        """Read the document that the sensor serves at ``/netftapi2.xml``.

        Counts per unit and the units are needed; name and rate are not: sensors differ in what else they tell.

        Raises:
            ProtocolError: Not XML, a web page or compressed, a needed field missing or not a positive number, a unit
                that is not known.
        """
        packed = document.startswith(b"\x1f\x8b")
        if packed or b"<html" in document[:1000].lower():
            raise ProtocolError(
                f"this is {'compressed' if packed else 'a web page'}, not the scaling document of a force sensor",
                where=where, value=repr(document[:40]), limit="the XML that a Net F/T serves at /netftapi2.xml",
                hint="Is the address right, and no login page or proxy before the sensor?",
            )  # fmt: skip
        try:
            root = fromstring(document)
        except (ParseError, DefusedXmlException, ValueError, LookupError) as fault:
            raise ProtocolError(f"not an XML document: {fault}", where=where) from fault

        field = _Fields(root, where)
        force, moment = field.unit("scfgfu", _NEWTON), field.unit("scfgtu", _NEWTON_METRE)
        range_n, range_nm = _calibrated(field, force, moment)
        return cls(
            force_n=force / field.number("cfgcpf"),
            moment_nm=moment / field.number("cfgcpt"),
            rate_hz=field.rate(),
            product=field.stated("prodname"),
            range_n=range_n,
            range_nm=range_nm,
        )


@dataclass(frozen=True)
class _Fields:
    """Fields of the document."""

    root: Element
    where: str  # Name of the document, for errors

    def stated(self, name: str) -> str:
        """Text of a field; empty where the document does not say it."""
        return (self.root.findtext(f".//{name}") or "").strip()

    def text(self, name: str) -> str:
        """Text of a field that is needed."""
        if not self.stated(name):
            raise ProtocolError(f"the field '{name}' is missing", where=self.where)
        return self.stated(name)

    def number(self, name: str) -> float:
        """Positive number of a field that is needed."""
        value = _positive(self.text(name))
        if value is None:
            raise ProtocolError(
                f"the field '{name}' is no positive number", where=self.where, value=repr(self.text(name))
            )
        return value

    def unit(self, name: str, known: dict[str, float]) -> float:
        """SI value of a unit."""
        plain = self.text(name).replace("-", "").replace("*", "").replace(" ", "").lower()
        if plain not in known:
            raise ProtocolError(
                "the sensor's unit is not known",
                where=f"{self.where}: {name}",
                value=self.text(name),
                limit=", ".join(known),
                hint="Choose another unit on the sensor's web page",
            )
        return known[plain]

    def rate(self) -> float | None:
        """Records per second, where the document gives them as a number."""
        return _positive(self.stated("comrdtrate"))

    def six(self, name: str) -> list[float]:
        """Six finite numbers; empty where the document does not say them."""
        try:
            values = [float(word) for word in self.stated(name).replace(";", " ").replace(",", " ").split()]
        except ValueError:
            return []
        return values if len(values) == 6 and all(map(math.isfinite, values)) else []


def _positive(text: str) -> float | None:
    """A number above 0 and below 1e12; None of anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0.0 < value < 1e12 else None


def _calibrated(field: _Fields, force: float, moment: float) -> tuple[Three, Three]:
    """Largest force and moment that the sensor is calibrated for, SI, about the axes in which it sends."""
    # Its document gives the ratings (``cfgmr``, 0 where it does not say) about its own origin. Where readings are moved
    # elsewhere (``cfgtfx``) the moment of the rated force over that way comes on top, and where they are turned the
    # rating is that of the whole vector. What does not say it is not watched, beyond what counts can show.
    rated = field.six("cfgmr")
    if not rated:
        return (math.inf,) * 3, (math.inf,) * 3
    limits = [value if value > 0.0 else math.inf for value in rated]
    forces, moments = [force * value for value in limits[:3]], [moment * value for value in limits[3:]]
    moved = field.six("cfgtfx")
    if any(moved[3:]):
        forces, moments = [math.hypot(*forces)] * 3, [math.hypot(*moments)] * 3
    if any(moved[:3]):
        way = math.hypot(*moved[:3]) * _METRE.get(field.stated("scfgtdu"), math.inf)
        moments = [value + way * math.hypot(*forces) for value in moments]
    return (forces[0], forces[1], forces[2]), (moments[0], moments[1], moments[2])


def write_scaling(counts_per_n: int, counts_per_nm: int, rate_hz: int, product: str) -> bytes:
    """The document that a sensor serves, in N and N m: the sensor's side."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<netft><prodname>{product}</prodname>'
        f"<cfgcpf>{counts_per_n}</cfgcpf><cfgcpt>{counts_per_nm}</cfgcpt><scfgfu>N</scfgfu><scfgtu>N-m</scfgtu>"
        f"<comrdtrate>{rate_hz}</comrdtrate></netft>\n"
    ).encode("ascii")


@dataclass(frozen=True)
class NetftRecord:
    """One record."""

    sequence: int  # +1 per record of the stream; a gap is a lost datagram. Wraps at 2^32.
    sample: int  # The sensor's own counter
    status: int  # 0 good, :data:`MONITOR` a warning, anything else a fault
    counts: tuple[int, int, int, int, int, int]  # Fx Fy Fz Tx Ty Tz

    def written(self) -> bytes:
        """The record as bytes: the sensor's side. Raises ProtocolError: a number does not fit its field."""
        try:
            return RECORD.pack(self.sequence, self.sample, self.status, *self.counts)
        except struct.error as fault:
            raise ProtocolError("a record's number does not fit its field", value=self.counts) from fault
