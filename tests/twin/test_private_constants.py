"""What the simulated cell fills in for itself stands in no cell file that is handed out."""

from __future__ import annotations

import math
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from counterflex.core.units import URAD
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth import nominal

ROOT = Path(__file__).parents[2]
SHIPPED = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples" / "cells").glob("*.toml"))}
SHIPPED["demonstration"] = (resources.files("counterflex.app") / "demo" / "cell.toml").read_text(encoding="utf-8")
ROBOTS = sorted((ROOT / "src" / "counterflex" / "robot" / "model" / "catalog_data").glob("*.toml"))
SHIPPED |= {path.name: path.read_text(encoding="utf-8") for path in ROBOTS}
UNCITED = ("", "assumed", "estimated", "guess")


def private() -> dict[str, set[float]]:
    """Values of the simulated drives by the key that a cell file has for them, in its units."""
    friction = nominal._LINK_FRICTION_NM
    return {
        "dead_band_half_urad": {value / URAD for value in nominal._HALF_PLAY_RAD},
        "friction_nm": {share * value for value in friction for share in nominal._SHARES}
        | set(friction)
        | set(nominal._MOTOR_FRICTION_NM),
        "slip_urad": {value / URAD for value in nominal._SLIP_RAD},
        "speed_gain_nm_s": {value * nominal.SPEED_BANDWIDTH_PER_S for value in nominal._SERVO_KG_M2},
        "position_gain_per_s": {nominal.POSITION_GAIN_PER_S},
        "integral_time_ms": {nominal.INTEGRAL_TIME_S * 1000.0},
    }


def found(text: str) -> list[str]:
    """Private values in a cell file, equal to three digits, in tables that cite nothing."""
    hits: list[str] = []

    def look(table: Any, where: str) -> None:
        if isinstance(table, list):
            for i, item in enumerate(table):
                look(item, f"{where}[{i}]")
        elif isinstance(table, dict):
            source = str(table.get("source", ""))
            cited = source not in UNCITED and not source.endswith(UNCITED[1:])
            for key, value in table.items():
                if isinstance(value, list | dict) and key not in private():
                    look(value, f"{where}.{key}")
                elif key in private() and not cited:
                    values = value if isinstance(value, list) else [value]
                    hits.extend(
                        f"{where}.{key} = {v}"
                        for v in values
                        if any(abs(v - secret) <= 0.5e-3 * secret for secret in private()[key])
                    )

    look(tomllib.loads(text), "")
    return hits


@pytest.mark.parametrize("name", SHIPPED)
def test_no_shipped_file_knows_a_constant_of_the_simulated_drives(name: str) -> None:
    assert found(SHIPPED[name]) == []


def test_a_constant_is_found_to_three_digits_and_may_be_cited() -> None:
    table = "[[robot.servo]]\naxis = 1\nspeed_gain_nm_s = 155500\nposition_gain_per_s = 21\n"
    assert found(table) == [".robot.servo[0].speed_gain_nm_s = 155500"]
    assert found(table + 'source = "load step on the standing axis, assumed"\n') != []
    assert found(table + 'source = "Haehn2020 table 1"\n') == []


def test_no_median_of_the_class_is_a_constant_of_the_simulated_drives() -> None:
    """A planner assumes what comes from published robots: of the robot that both describe, no value is the same."""
    given, secret = read_cell(ROOT / "examples" / "cells" / "kr300_d16_small.toml").class_drives, private()
    assert given is not None
    prior = given.prior
    servos, plays = [prior.servo(axis) for axis in range(6)], [prior.play(axis) for axis in range(6)]
    assumed = {
        "speed_gain_nm_s": [math.exp(0.5 * prior.yield_log_sigma**2) * one.speed_gain_nm_s for one in servos],
        "position_gain_per_s": [one.position_gain_per_s for one in servos],
        "integral_time_ms": [1000.0 * one.integral_time_s for one in servos],
        "friction_nm": [
            *prior.friction_nm,
            *(one.friction_nm for one in servos),
            *(one.friction_nm[0] for one in plays),
        ],
        "dead_band_half_urad": [one.half_band_rad / URAD for one in plays],
        "slip_urad": [one.slip_rad[0] / URAD for one in plays],
    }
    for key, values in assumed.items():
        for value in values:
            assert all(abs(value - one) > 5e-3 * one for one in secret[key]), (key, value)
