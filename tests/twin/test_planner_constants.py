"""No constant of the planner is one of the simulated cell's: a planner that knows them is judged by its own answers.

Compared are the numbers that modules and tables of defaults name: equal to three digits, of the same unit and with a
word of their name in common. What both may know stands in :data:`COMMON` with the reason.
"""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
from pydantic import BaseModel

import counterflex
from counterflex.core.units import URAD

ROOT = Path(__file__).parents[2]
CELLS = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples" / "cells").glob("*.toml"))}
CELLS["demonstration"] = (resources.files("counterflex.app") / "demo" / "cell.toml").read_text(encoding="utf-8")
UNITS = ("kg_m2", "kg_m3", "n_m", "m_s2", "m_s", "per_s", "nm", "rad", "kg", "pa", "hz", "s", "m", "n", "c")
NO_QUANTITIES = {"sigma", "share", "seed", "first", "version", "order", "digits", "rated", "kinds"}
COMMON = {
    (
        "nominal.POSITION_GAIN_PER_S",
        "links.EgmTable.position_gain_per_s",
    ): "largest gain of the controller, ABB 3HAC073318",
    ("force_sensor.REFERENCE_C", "flange_sensor.FlangeSensor.reference_c"): "ISO 1",
    ("force_sensor.REFERENCE_C", "flange_sensor.REFERENCE_C"): "ISO 1",
    ("force_sensor.REFERENCE_C", "sensing.HolderTable.reference_c"): "ISO 1",
    ("force_sensor.REFERENCE_C", "sensing.SensorTable.reference_c"): "ISO 1",
    ("force_sensor.REFERENCE_C", "strain_holder.StrainHolder.reference_c"): "ISO 1",
    ("controller.CYCLE_S", "writer.InformSettings.cycle_s"): "interpolation clock of DX200 and YRC1000",
    ("controller.Controller.cycle_s", "writer.InformSettings.cycle_s"): "interpolation clock of DX200 and YRC1000",
    ("controller.CYCLE_S", "recipe.CYCLE_S"): "cycle of KUKA RSI, data sheet",
    ("controller.Controller.cycle_s", "recipe.CYCLE_S"): "cycle of KUKA RSI, data sheet",
    ("controller.CYCLE_S", "job.Val3Settings.cycle_s"): "cycle of a Staubli controller, which is also 4 ms",
    ("controller.Controller.cycle_s", "job.Val3Settings.cycle_s"): "cycle of a Staubli controller, also 4 ms",
    ("controller.Controller.acceleration_m_s2", "inputs.Setting.acceleration_m_s2"): "key of the cell file, round",
    ("plant.STEP_S", "elastic_motion.STEP_S"): "step of integration",
    ("column_material._TINY_M", "column_block_kernels._TINY_M"): "below it two ends of material are one: rounding",
    ("column_material._TINY_M", "step_kernels._TINY_M"): "below it two ends of material are one: rounding",
    ("controller.Controller.acceleration_m_s2", "survey.RobotHere.acceleration_m_s2"): "key of the cell file, round",
    ("other_forces._FADE_RAD", "elastic_region.FADE_RAD"): "meaning of the cell file's regions",
    ("other_forces._FADE_RAD", "drive_error.FADE_RAD"): "meaning of the cell file's regions",
    ("perturb.RUNOUT_M", "considered.RUNOUT_M"): "collet chucks: 10 um at the edges, docs/identify/cutting.md",
    ("nominal._SLIP_RAD", "description.Servo.slip_rad"): "of the motor, which the simulated cell has at 25 urad",
    ("nominal._SLIP_RAD", "recipe.GUESS.slip_rad"): "of the motor, which the simulated cell has at 25 urad",
    ("strain_holder.FORCE_N", "proposal.FORCE_N"): "noise of the instrument that a shop would use, stated in proposals",
    ("strain_holder.FORCE_N", "considered.FORCE_N"): "another quantity: mean of a piece",
    (
        "strain_holder.SAMPLE_S",
        "settings.MonitorSettings.sample_s",
    ): "period of the force sensor, set from the cell file",
    ("draw_other._RUNOUT_M", "considered.RUNOUT_M"): "collet chucks: 10 um at the edges, docs/identify/cutting.md",
    (
        "perturb.BEARING_M",
        "blocks.BEARING_M",
    ): "OPEN: nothing is published of bearing centres; a judgement, as the twin's",
    (
        "perturb.BEARING_M",
        "recipe.BEARING_M",
    ): "OPEN: nothing is published of bearing centres; a judgement, as the twin's",
}


class Constant(NamedTuple):
    """A number of a module: ``module.NAME`` or ``module.Class.field``, and its value."""

    name: str
    value: float


def modules(package: str) -> Iterator[ModuleType]:
    """All modules of the program whose name begins so."""
    for info in pkgutil.walk_packages(counterflex.__path__, "counterflex."):
        if info.name.startswith(package) and not info.name.endswith("__main__"):
            yield importlib.import_module(info.name)


def numbers(value: Any, name: str) -> Iterator[Constant]:
    """Numbers in a value, in its items and its fields."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield Constant(name, float(value))
    elif isinstance(value, list | tuple):
        for item in value:
            yield from numbers(item, name)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            yield from numbers(getattr(value, field.name, None), f"{name}.{field.name}")


def constants(module: ModuleType) -> Iterator[Constant]:
    """Constants that a module defines, and defaults of its classes."""
    short = module.__name__.rpartition(".")[2]
    own = Path(module.__file__ or "").read_text(encoding="utf-8")
    for name, value in vars(module).items():
        if name.isupper() and (f"\n{name}: " in own or f"\n{name} = " in own):
            yield from numbers(value, f"{short}.{name}")
        elif isinstance(value, type) and value.__module__ == module.__name__:
            if dataclasses.is_dataclass(value):
                for field in dataclasses.fields(value):
                    yield from numbers(field.default, f"{short}.{name}.{field.name}")
            elif issubclass(value, BaseModel):
                for key, entry in value.model_fields.items():
                    yield from numbers(entry.default, f"{short}.{name}.{key}")


def unit(name: str) -> str:
    """Unit at the end of a name; empty where there is none."""
    last = name.lower().rpartition(".")[2]
    return next((unit for unit in UNITS if last.endswith(f"_{unit}")), "")


def words(name: str) -> set[str]:
    """Words of a name that say which quantity it is."""
    last = name.lower().partition(".")[2].replace(".", "_")
    return {word for word in last.split("_") if len(word) > 2} - NO_QUANTITIES - {"rad"}


def shared(secret: list[Constant], known: list[Constant]) -> set[tuple[str, str]]:
    """Pairs of the same quantity and value."""
    return {
        (ours.name, theirs.name)
        for ours in secret
        for theirs in known
        if abs(ours.value - theirs.value) <= 0.5e-3 * abs(ours.value)
        and unit(ours.name) == unit(theirs.name) != ""
        and words(ours.name) & words(theirs.name)
    }


@pytest.fixture(scope="module")
def secret() -> list[Constant]:
    """What the simulated cell fills in and how it is put off."""
    packages = ("counterflex.twin.truth", "counterflex.twin.plant")
    return [c for package in packages for module in modules(package) for c in constants(module) if c.value != 0.0]


def test_no_constant_of_the_planner_is_one_of_the_simulated_cell(secret: list[Constant]) -> None:
    known = [
        constant
        for module in modules("counterflex.")
        if not module.__name__.startswith("counterflex.twin") and not module.__name__.endswith((".simulated", ".alone"))
        for constant in constants(module)
    ]
    assert len(known) > 1000
    assert shared(secret, known) - set(COMMON) == set()
    assert set(COMMON) - shared(secret, known) == set(), "said of constants that no longer agree"


def test_a_constant_that_is_taken_over_is_found(secret: list[Constant]) -> None:
    gain, slip = Constant("recipe.GUESS.position_gain_per_s", 20.0), Constant("parameters.USUAL.slip_rad", 25.0 * URAD)
    assert {theirs for _, theirs in shared(secret, [gain, slip])} == {gain.name, slip.name}
    assert shared(secret, [gain._replace(value=21.0), slip._replace(name="parameters.USUAL.angle_rad")]) == set()


@pytest.mark.parametrize("name", CELLS)
def test_no_shipped_cell_has_been_measured_on_the_simulated_one(name: str) -> None:
    """Modes, dead times, delays, gains and sag are results of measurements, and no real cell was measured."""
    cell = tomllib.loads(CELLS[name])
    for table in ("dynamics", "timing", "identified", "drive_error", "axis_sag"):
        assert table not in cell, table
