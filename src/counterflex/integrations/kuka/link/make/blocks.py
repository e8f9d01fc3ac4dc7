"""Objects of KUKA RSI that a correction needs: numbers, ports and parameters, as published contexts show them.

RSI 3 (``.rsi.xml``) counts ports and parameters from 1, RSI 4 and 5 (``.rsix``) from 0; the numbers of parameters are
not simply shifted. Values of a choice are written as ordinals where the controller reads them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

ValueKind = Literal["double", "int", "text", "stop", "frame"]
STOP_MODES: Final = ("InfoMessage", "PathNormal", "Velocity", "PathFast", "ExitMoveCorr")
FRAMES: Final = ("World", "Base", "RobRoot", "Tool", "TTS")
_POSE: Final = ("X", "Y", "Z", "A", "B", "C")
_AXES: Final = tuple(f"A{i}" for i in range(1, 7))


@dataclass(frozen=True)
class ParameterType:
    """A parameter of an object."""

    name: str  # As in both generations
    first: int  # ParamID of RSI 3
    second: int  # ParamId of RSI 4 and 5
    kind: ValueKind = "double"  # What it holds
    default: str = "0"  # As published, text of the editor
    least: int | None = None  # Smallest value, or None
    most: int | None = None  # Largest value, or None
    runtime: bool = True  # It may be changed while the context runs

    def ordinal(self, value: float | str) -> str:
        """A value as the controller reads it: choices as numbers."""
        if self.kind == "stop":
            return str(STOP_MODES.index(str(value)))
        if self.kind == "frame":
            return str(FRAMES.index(str(value)))
        return spelled(value)


@dataclass(frozen=True)
class BlockType:
    """A type of object."""

    name: str  # In capitals, as RSI 3 writes it
    mixed: str  # As RSI 4 and 5 write it
    number: int  # ObjTypeID
    inputs: tuple[str, ...] = ()  # Names of the ports, in order; those of ETHERNET are numbered
    outputs: tuple[str, ...] = ()  # Likewise
    parameters: tuple[ParameterType, ...] = ()  # In order
    whole: tuple[str, ...] = ()  # Outputs that are whole numbers
    truth: bool = False  # Its input is a truth value
    optional: bool = False  # Its inputs may stay open

    def parameter(self, name: str) -> ParameterType:
        """A parameter by its name."""
        return next(item for item in self.parameters if item.name == name)


def _limits(axes: tuple[str, ...], upper_first: int) -> tuple[ParameterType, ...]:
    n = len(axes)
    low = [ParameterType(f"LowerLim{a}", 1 + i, i, default="-5", most=0) for i, a in enumerate(axes)]
    high = [ParameterType(f"UpperLim{a}", upper_first + i, n + i, default="5", least=0) for i, a in enumerate(axes)]
    return (*low, *high)


_INDEX: Final = ParameterType("Index", 1, 0, "int", "1", 1, 20)
TYPES: Final[dict[str, BlockType]] = {
    item.name: item
    for item in (
        BlockType(
            "ETHERNET",
            "Ethernet",
            64,
            tuple(f"In{i}" for i in range(1, 65)),
            tuple(f"Out{i}" for i in range(1, 65)),
            (
                ParameterType("ConfigFile", 1, 0, "text", "RSIEthernet.xml", runtime=False),
                ParameterType("Timeout", 1, 0, "int", "10", 0),
                ParameterType("Flag", 4, 3, "int", "-1", -1, 999),
                ParameterType("Precision", 8, 7, "int", "1", 1, 32),
            ),
            optional=True,
        ),
        BlockType(
            "POSCORR",
            "PosCorr",
            27,
            tuple(f"Corr{a}" for a in _POSE),
            ("Stat", *_POSE),
            (
                *_limits(("X", "Y", "Z"), 4),
                ParameterType("MaxRotAngle", 7, 6, default="5", least=0),
                ParameterType("RefCorrSys", 1, 0, "frame", "Base", runtime=False),
            ),
            whole=("Stat",),
            optional=True,
        ),
        BlockType(
            "POSCORRMON",
            "PosCorrMon",
            81,
            (),
            _POSE,
            (
                ParameterType("MaxTrans", 1, 0, default="6", least=0),
                ParameterType("MaxRotAngle", 2, 1, default="6", least=0),
            ),
        ),
        BlockType(
            "AXISCORR",
            "AxisCorr",
            33,
            tuple(f"Corr{a}" for a in _AXES),
            ("Stat", *_AXES),
            _limits(_AXES, 13),
            whole=("Stat",),
            optional=True,
        ),
        BlockType(
            "AXISCORRMON",
            "AxisCorrMon",
            82,
            (),
            (*_AXES, *(f"E{i}" for i in range(1, 7))),
            tuple(ParameterType(f"Max{a}", i + 1, i, default="6", least=0) for i, a in enumerate(_AXES)),
        ),
        BlockType(
            "STOP",
            "Stop",
            18,
            ("In1",),
            (),
            (ParameterType("Mode", 1, 0, "stop", "ExitMoveCorr"), ParameterType("Channel", 2, 1, "int", "0", 0)),
            truth=True,
        ),
        BlockType("MAP2SEN_PREA", "Map2Sen_PRea", 17, ("In1",), (), (_INDEX,)),
        BlockType("SEN_PREA", "Sen_PRea", 58, (), ("Out1",), (_INDEX,)),
        BlockType("MAP2OV_PRO", "Map2OV_PRO", 25, ("In1",)),
    )
}
"""By name in capitals. Sources: contexts of KUKA's external control SDK (RSI 3, 4, 5) and of RSIPI (RSI 3)."""


@dataclass(frozen=True)
class ContextBlock:
    """One object of a context that is written."""

    kind: str  # Key of :data:`TYPES`
    name: str  # ObjID, different for every object
    wires: dict[int, tuple[str, int]] = field(default_factory=dict)  # Input (from 1) to object and its output (from 1)
    # Of parameters, by name: numbers, texts, words of a choice
    values: dict[str, float | str] = field(default_factory=dict)
    public: frozenset[str] = frozenset()  # Parameters that the KRL program may set

    @property
    def type(self) -> BlockType:
        """Its type."""
        return TYPES[self.kind]

    def given(self) -> list[tuple[ParameterType, float | str]]:
        """Its parameters in the order of the type."""
        return [(item, self.values[item.name]) for item in self.type.parameters if item.name in self.values]


def spelled(value: float | str) -> str:
    """A value as editors read it: choices as words."""
    return value if isinstance(value, str) else f"{value:g}"


def used_ports(blocks: tuple[ContextBlock, ...], block: ContextBlock) -> tuple[int, int]:
    """Number of inputs and outputs of an object that are drawn: all, those of ETHERNET up to the last one in use."""
    kind = block.type
    if block.kind != "ETHERNET":
        return len(kind.inputs), len(kind.outputs)
    outputs = [output for item in blocks for source, output in item.wires.values() if source == block.name]
    return max(1, *block.wires), max(1, *outputs)
