"""Scenario files (``counterflex-scenario``, version 1): what is set once for a trial, in shop units.

A trial may be described by several layers: a file, the name of a scenario that comes with counterflex, and single keys
``TABLE.KEY=VALUE``; the later layer wins. Each command reads the tables that concern it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.similar import close_to, missing_file
from counterflex.files import fault_file
from counterflex.files.fault_file import FaultTable
from counterflex.files.schema import Table, Versioned, check_header, parse, read_toml
from counterflex.programs.language import BY_ENDING, dialects

KIND: Final = "counterflex-scenario"
VERSION: Final = 1

Six = tuple[float, float, float, float, float, float]
Address = Annotated[str, Field(pattern=r"^[^:\s]+:\d{1,5}$")]
AtLeast0 = Annotated[float, Field(ge=0.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Milliseconds = Annotated[float, Field(ge=0.0, le=60000.0)]
Rate = Annotated[int, Field(ge=1, le=7000)]
_ZERO: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _known_dialect(name: str) -> str:
    if name not in (known := list(dialects())):
        raise ValueError(f"no known language of programs: {name}; expected {', '.join(known)}")
    return name


class CompensationTable(Table):
    """Correction by ``compensate``."""

    dialect: Annotated[str, AfterValidator(_known_dialect)] = BY_ENDING
    tolerance_um: Annotated[float, Field(ge=0.1, le=1000.0)] = 5.0
    normal_only: bool = False
    feed_for_tolerance_um: Annotated[float, Field(ge=0.1, le=10000.0)] | None = None
    least_feed_percent: Annotated[float, Field(ge=5.0, le=100.0)] = 30.0
    least_chip_um: Annotated[float, Field(ge=0.0, le=1000.0)] = 10.0


class RunTable(Table):
    """Settings of ``run`` besides its files."""

    program: Path | None = None
    currents: bool = False
    listen: str = "127.0.0.1"
    peer: Address | None = None
    lockstep: bool = False
    seconds: Annotated[float, Field(ge=0.1)] | None = None


class ScenarioControllerTable(Table):
    """A simulated robot controller, whatever it speaks."""

    peer: Address | None = None
    realtime: bool = False
    wait_s: AtLeast0 = 60.0
    gate_s: AtLeast0 | None = None
    answer_ms: Annotated[float, Field(gt=0.0)] | None = None
    dead_ms: AtLeast0 = 12.0
    natural_hz: AtLeast0 = 5.0
    damping: Annotated[float, Field(ge=0.01)] = 0.7


class RsiTable(Table):
    """RSI on a KUKA controller."""

    mode: Literal["absolute", "relative"] = "absolute"
    cycle_ms: Literal[4, 12] = 4
    timeout: Annotated[int, Field(ge=1, le=10**9)] = 100
    precision: Annotated[int, Field(ge=0, le=9)] = 4
    clamp_mm: float = 5.0
    clamp_deg: float = 5.0
    axis_clamp_deg: float = 5.0
    monitor_mm: float = 6.0
    monitor_deg: float = 6.0
    empty_first: bool = False


class ScenarioEgmTable(Table):
    """EGM on an ABB controller, beside what the cell file says."""

    robotware: Literal[6, 7] = 7
    own_force: bool = False
    wrench_n_nm: Six | None = None
    timeout_ms: Annotated[float, Field(gt=0.0)] | None = None


class StandstillTable(Table):
    """Place of a robot without a program: with a cell the pose follows from the angles."""

    pose_mm_deg: Six | None = None
    joints_deg: Six = (0.0, -90.0, 90.0, 0.0, 30.0, 0.0)


class ForceSensorTable(Table):
    """A force sensor: where it is, and what a simulated one alone shows."""

    address: Address | None = None
    http_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    rate_hz: Rate = 1000
    wrench_n_nm: Six = _ZERO
    amplitude_n_nm: Six = _ZERO
    sine_hz: AtLeast0 = 1.0
    repeat: bool = False
    noise_n: AtLeast0 = 1.0
    noise_nm: AtLeast0 = 0.1
    status: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = 0


class ScenarioTrackerTable(Table):
    """A tracker: where its datagrams go, how often, how late, and how a simulated one alone is off."""

    address: Address | None = None
    rate_hz: Annotated[float, Field(ge=0.1, le=7000.0)] = 1000.0
    late_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0
    noise_um: AtLeast0 = 15.0
    noise_urad: AtLeast0 = 30.0
    speed: Annotated[float, Field(ge=0.01, le=100.0)] = 1.0
    repeat: bool = False
    clock_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0


class TargetTable(Table):
    """Target that a tracker alone sees: it stands, or moves on a circle or square in the xy plane of its pose."""

    pose_mm_deg: Six = (3000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    circle_radius_mm: Annotated[float, Field(gt=0.0)] | None = None
    square_side_mm: Annotated[float, Field(gt=0.0)] | None = None
    feed_mm_min: Annotated[float, Field(ge=0.001)] = 700.0


class StrainTable(Table):
    """Strains of an instrumented holder: where their datagrams go, and what simulated amplifiers show."""

    address: Address | None = None
    ads: Address | None = None
    rate_hz: Literal[200, 250, 500, 1000, 2000] = 1000
    warm_k: Annotated[float, Field(ge=-50.0, le=50.0)] = 3.0
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise_um_m: AtLeast0 = 0.0


class NetworkTable(Table):
    """Faults of a network on datagrams (:class:`counterflex.twin.network.impairment.Impairment`)."""

    way: Literal["both", "there", "back"] = "both"
    loss: Share = 0.0
    burst_share: Share = 0.0
    burst_mean: Annotated[float, Field(ge=1.0)] = 3.0
    pattern: Annotated[str, Field(pattern="^[01]*$")] = ""
    delay_ms: Milliseconds = 0.0
    jitter_ms: Milliseconds = 0.0
    duplicate: Share = 0.0
    reorder: Share = 0.0
    reorder_ms: Milliseconds = 6.0
    flip: Share = 0.0
    truncate: Share = 0.0
    garbage: Share = 0.0
    stall_first: Annotated[int, Field(ge=0)] = 0
    stall_count: Annotated[int, Field(ge=0)] = 0
    period_ms: Annotated[float, Field(ge=0.01, le=60000.0)] = 4.0
    first: Annotated[int, Field(ge=0)] = 0


class Scenario(Versioned):
    """A whole scenario."""

    format: str = KIND
    version: int = VERSION
    title: str = ""
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    compensation: CompensationTable = CompensationTable()
    run: RunTable = RunTable()
    controller: ScenarioControllerTable = ScenarioControllerTable()
    rsi: RsiTable = RsiTable()
    egm: ScenarioEgmTable = ScenarioEgmTable()
    standstill: StandstillTable = StandstillTable()
    force_sensor: ForceSensorTable = ForceSensorTable()
    tracker: ScenarioTrackerTable = ScenarioTrackerTable()
    target: TargetTable = TargetTable()
    strain: StrainTable = StrainTable()
    network: NetworkTable = NetworkTable()
    faults: tuple[FaultTable, ...] = ()


def shipped() -> dict[str, str]:
    """Text of the scenarios that come with counterflex, by name."""
    folder = resources.files("counterflex.files") / "scenario_data"
    files = (item for item in folder.iterdir() if item.name.endswith(".toml"))
    return {item.name.removesuffix(".toml"): item.read_text(encoding="utf-8") for item in sorted(files, key=str)}


def read_scenario(layers: Iterable[str], tables: Sequence[str]) -> Scenario:
    """A scenario from its layers.

    Args:
        layers: Each a file, the name of a scenario that comes with counterflex, or ``TABLE.KEY=VALUE``; later ones win.
        tables: That the command reads: a single key of another one is refused, it would have no effect.

    Raises:
        InputError: A name or key is unknown, or a value is out of range.
    """
    results: dict[str, Any] = {}
    where = "scenario"
    for layer in layers:
        if "=" in layer:
            data, where = _single(layer, tables), f"--scenario {layer}"
        elif layer in (known := shipped()):
            data, where = tomllib.loads(known[layer]), f"scenario {layer}"
        else:
            data, where = _file(layer), layer
        _checked(data, where, InputError if "=" in layer else FileFormatError)
        for key, value in data.items():
            results[key] = {**results.get(key, {}), **value} if isinstance(value, dict) else value
    return _checked(results, where, InputError)


def _checked(data: dict[str, Any], where: str, kind: Callable[..., Exception]) -> Scenario:
    try:
        return parse(Scenario, data, where=where)
    except FileFormatError as fault:
        raise kind(fault.what, where=fault.where, value=fault.value, limit=fault.limit, hint=fault.hint) from None


def _file(layer: str) -> dict[str, Any]:
    """A scenario file, or a fault file: that is one with a seed and faults only."""
    file = Path(layer)
    if not file.is_file():
        names = list(shipped())
        close = close_to(layer, names, 1)
        raise InputError(
            "no such scenario",
            where=f"--scenario {layer}",
            limit=f"a file, TABLE.KEY=VALUE, or one of {', '.join(names)}",
            hint=f"Did you mean '{close[0]}'?" if close else missing_file(file),
        )
    data = read_toml(file, KIND)
    old = data.get("format") == fault_file.KIND
    check_header(data, kind=fault_file.KIND if old else KIND, version=VERSION, where=str(file))
    program = data.get("run", {}).get("program") if isinstance(data.get("run"), dict) else None
    if isinstance(program, str):
        data["run"]["program"] = str(file.parent / program)
    return data


def _single(text: str, tables: Sequence[str]) -> dict[str, Any]:
    key, _, value = (part.strip() for part in text.partition("="))
    table, dot, name = key.partition(".")
    if not dot:
        table, name = "", key
    allowed = ("seed", *(f"{item}.KEY" for item in tables))
    if (table and table not in tables) or (not table and name != "seed"):
        close = close_to(table or name, (*tables, "seed"), 1)
        raise InputError(
            "this command reads no such key",
            where=f"--scenario {text}",
            value=key,
            limit=", ".join(allowed),
            hint=f"Did you mean '{close[0]}'?" if close else None,
        )
    try:
        read: Any = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        read = value
        if "," in value:
            try:
                read = [float(part) for part in value.split(",")]
            except ValueError:
                read = value
    return {table: {name: read}} if table else {name: read}
