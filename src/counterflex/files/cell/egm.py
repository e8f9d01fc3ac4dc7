"""Table ``[egm]`` of a cell file: how an ABB controller and the online loop work together, in shop units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from counterflex.core.errors import InputError
from counterflex.files.cell.online import OnlineTable
from counterflex.files.schema import Table

Above = Annotated[float, Field(gt=0.0, le=1e6)]
Level = Annotated[float, Field(ge=0.0, le=1e6)]
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
