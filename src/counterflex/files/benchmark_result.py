"""Results of the benchmark part (``counterflex-benchmark-result``, version 1): one part of one laboratory, JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError
from counterflex.files.schema import Table, check_header, parse

KIND: Final = "counterflex-benchmark-result"
VERSION: Final = 1
NAME: Final = "CF-1"


class Characteristic(NamedTuple):
    """Nominal value and tolerance of one quantity by the drawing."""

    feature: str  # Its name, as :func:`counterflex.evaluate.feature_finding.find_features` gives it
    quantity: str
    nominal_mm: float
    tolerance_mm: float  # Permitted deviation, +-; width of the zone where the nominal value is 0


def _groove(name: str, width_mm: float, depth_mm: float) -> tuple[Characteristic, ...]:
    return (
        Characteristic(name, "width", width_mm, 0.1),
        Characteristic(name, "wall left", 0.5 * width_mm, 0.1),
        Characteristic(name, "wall right", 0.5 * width_mm, 0.1),
        Characteristic(name, "depth", depth_mm, 0.1),
        Characteristic(name, "flatness", 0.0, 0.05),
    )


MEASURED: Final = (
    *_groove("groove 1", 16.0, 4.0),
    *_groove("groove 2", 10.0, 3.0),
    Characteristic("pocket 1", "diameter", 24.0, 0.1),
    Characteristic("pocket 1", "roundness", 0.0, 0.1),
    Characteristic("pocket 1", "centre", 0.0, 0.1),
    Characteristic("pocket 1", "depth", 3.0, 0.1),
    Characteristic("pocket 1", "flatness", 0.0, 0.05),
)
"""Everything that is measured on the part, with its tolerance."""

Millimetres = Annotated[float, Field(ge=-100.0, le=100.0)]
Text = Annotated[str, Field(min_length=1, max_length=200)]


class FeatureResult(Table):
    """One quantity of one feature."""

    feature: Text
    quantity: Text
    nominal_mm: Millimetres
    tolerance_mm: Annotated[float, Field(gt=0.0, le=100.0)]
    worst_mm: Millimetres
    mean_mm: Millimetres
    uncertainty_um: Annotated[float, Field(ge=0.0, le=1e5)]
    within: bool

    @property
    def deviation_mm(self) -> float:
        """Worst value minus nominal."""
        return self.worst_mm - self.nominal_mm

    @model_validator(mode="after")
    def _judged_rightly(self) -> Self:
        rounding = 1e-4  # values are written with four digits behind the point
        if abs(abs(self.deviation_mm) - self.tolerance_mm) > rounding:
            inside = abs(self.deviation_mm) <= self.tolerance_mm
            if inside != self.within:
                raise ValueError(
                    f"within is {self.within}, but {self.quantity} of {self.feature} is {self.deviation_mm:+.4f} mm off"
                )
        return self


class BenchmarkResult(Table):
    """A whole result."""

    format: Literal["counterflex-benchmark-result"] = KIND
    version: Literal[1] = VERSION
    part: Literal["CF-1"] = NAME
    laboratory: Text
    robot: Text
    material: Text
    method: Literal["uncompensated", "catalogue", "identified", "corrected", "online"]
    program_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    scan: Text
    scan_points: Annotated[int, Field(ge=1)]
    scan_noise_um: Annotated[float, Field(ge=0.0, le=1e5)]
    placed_by: Annotated[tuple[str, ...], Field(max_length=6)]
    residual_um: Annotated[float, Field(ge=0.0, le=1e5)]
    surface_p997_mm: Annotated[float, Field(ge=0.0, le=100.0)]
    features: tuple[FeatureResult, ...]
    counterflex: Text

    @property
    def label(self) -> str:
        """Return what the result is called beside others."""
        return f"{self.laboratory}, {self.method}"

    @model_validator(mode="after")
    def _of_this_part(self) -> Self:
        given = [Characteristic(row.feature, row.quantity, row.nominal_mm, row.tolerance_mm) for row in self.features]
        names = [(row.feature, row.quantity) for row in given]
        stated_rows = {(row.feature, row.quantity): row for row in MEASURED}
        if len(set(names)) != len(names) or set(names) != set(stated_rows):
            odd = sorted(set(names) ^ set(stated_rows)) or sorted(name for name in names if names.count(name) > 1)
            raise ValueError(f"the features are not those of {NAME}: {odd[0][1]} of {odd[0][0]}")
        for row in given:
            stated = stated_rows[row.feature, row.quantity]
            if abs(row.nominal_mm - stated.nominal_mm) > 2e-3 or row.tolerance_mm != stated.tolerance_mm:
                raise ValueError(
                    f"{row.quantity} of {row.feature} is judged against {row.nominal_mm:g} +- {row.tolerance_mm:g} mm; "
                    f"the drawing says {stated.nominal_mm:g} +- {stated.tolerance_mm:g} mm"
                )
        return self


def write_benchmark_result(path: Path, result: BenchmarkResult) -> None:
    """Write a result."""
    atomic.write_text(path, json.dumps(result.model_dump(mode="json"), indent=2) + "\n")


def read_benchmark_result(path: str | Path) -> BenchmarkResult:
    """Read and check a result.

    Raises:
        FileFormatError: Missing, not JSON, another format, newer than this program, of another part, or contradictory.
    """
    file = Path(path)
    data: Any = file_content.json_value(file)
    if not isinstance(data, dict):
        raise FileFormatError(f"not a {KIND} file", where=str(file))
    check_header(data, kind=KIND, version=VERSION, where=str(file))
    return parse(BenchmarkResult, data, where=str(file))
