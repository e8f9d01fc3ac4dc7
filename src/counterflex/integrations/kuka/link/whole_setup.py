"""A KUKA RSI set-up as a whole: ETHERNET file, context, KRL program, limits of the loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.units import DEG, MM
from counterflex.integrations.kuka.link.calls import RsiCalls
from counterflex.integrations.kuka.link.config import ConfigValue, RsiConfig
from counterflex.integrations.kuka.link.context import ContextObject, RsiContextFile
from counterflex.protocols.finding import Finding

POSE: Final = tuple(f"RKorr.{axis}" for axis in "XYZABC")
AXIS_WORDS: Final = ("AKorr", "AK")
_LEVER_M: Final = 0.2


@dataclass(frozen=True)
class OnlineLimits:
    """Limits that the table ``[online]`` of a cell promises."""

    correction_mm: float  # Largest length of the correction
    correction_deg: float  # Largest angle of it
    hard_factor: float  # Beyond the limits times this the loop faults
    period_ms: int  # Cycle, 4 or 12
    axes: bool = False  # Axis corrections are sent, not Cartesian ones
    orientation: bool = False  # The orientation is corrected too
    override: bool | None = None  # The cell lets the loop change the speed of the program; None where nobody says

    @property
    def axis_deg(self) -> float:
        """Largest correction of one axis: that of the tool on a lever of 0.2 m, and its angle, deg."""
        return self.correction_mm * MM / _LEVER_M / DEG + self.correction_deg


@dataclass(frozen=True)
class Setup:
    """Everything that is known of one set-up."""

    config: RsiConfig  # ETHERNET file
    context: RsiContextFile | None = None  # Context, or None
    program: RsiCalls | None = None  # KRL program, or None
    limits: OnlineLimits | None = None  # Of the loop, or None
    # Other UDP ports in use on the sensor computer, by what uses them
    ports: dict[str, int] = field(default_factory=dict)

    @property
    def received(self) -> dict[str, ConfigValue]:
        """Values of the answer by name."""
        return {value.name: value for value in self.config.received()}

    @property
    def sent(self) -> dict[str, ConfigValue]:
        """Values of the telegram by name."""
        return {value.name: value for value in self.config.sent()}

    @property
    def pose_values(self) -> tuple[ConfigValue, ...]:
        """``RKorr`` values that are declared."""
        return tuple(value for name, value in self.received.items() if name.split(".")[0] == "RKorr")

    @property
    def axis_values(self) -> tuple[ConfigValue, ...]:
        """``AKorr`` or ``AK`` values that are declared."""
        return tuple(value for name, value in self.received.items() if name.split(".")[0] in AXIS_WORDS)

    @property
    def corrections(self) -> tuple[ConfigValue, ...]:
        """Every correction that is declared."""
        return self.pose_values + self.axis_values

    @property
    def ethernet(self) -> ContextObject | None:
        """ETHERNET object of the context, or None."""
        objects = self.context.of_kind("ETHERNET") if self.context else ()
        return objects[0] if objects else None

    def at(self, tag: str) -> str:
        """Place of a tag, for messages."""
        return f"{self.config.where}: {tag}"

    def within(self, item: ContextObject, parameter: str = "") -> str:
        """Place of a parameter of the context, for messages."""
        return f"{self.context.where if self.context else ''}: {item.name} {parameter}".rstrip()

    def on_line(self, line: int) -> str:
        """Place in the KRL program, for messages."""
        return f"{self.program.where if self.program else ''}:{line}"

    def parameter(self, item: ContextObject, name: str, default: float) -> float:
        """A parameter as it is in force: what the program sets, else the context, else the default."""
        value = self.program.public_parameters().get((item.name, name), (None, 0))[0] if self.program else None
        return item.number(name, default) if value is None else value


Rule = Callable[[Setup], Iterator[Finding]]


def message_variables(setup: Setup, name: str) -> tuple[str, ...]:
    """Variables ``$SEN_PREA[n]`` and ``$SEN_PINT[n]`` that a tag of the answer arrives in, as KRL writes them."""
    item, value = setup.ethernet, setup.received.get(name)
    if setup.context is None or item is None or value is None or value.tag.channel is None:
        return ()
    ends, _ = setup.context.reached(item.name, value.tag.channel)
    words = {"MAP2SEN_PREA": "$SEN_PREA", "MAP2SEN_PINT": "$SEN_PINT"}
    return tuple(f"{words[end.kind]}[{int(end.number('Index', 1.0))}]" for end, _ in ends if end.kind in words)
