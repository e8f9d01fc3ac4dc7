"""Drawing of a force-sensing spindle holder (``counterflex-holder``, version 1): cheeks and pockets, shop units."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.units import KN, MICRO, MM, N_PER_MM2
from counterflex.files.schema import Length, Table, Versioned
from counterflex.sensing.holder_beam import HolderBeam
from counterflex.sensing.holder_design.drawing import Drawing, Pocket

KIND: Final = "counterflex-holder"
VERSION: Final = 1
_GPA = KN * N_PER_MM2
Size = Annotated[float, Field(gt=0.0, le=2000.0)]


class CheeksTable(Table):
    """The two cheeks between the clamped end and the ring."""

    length_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    distance_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    thickness_mm: Annotated[float, Field(gt=0.5, le=500.0)]
    width_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    youngs_modulus_gpa: Annotated[float, Field(gt=1.0, le=1000.0)] = 210.0
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.3


class PocketTable(Table):
    """One pocket, or the same one in both cheeks."""

    cheek: Literal["-x", "+x", "both"]
    face: Literal["outer", "inner"] = "outer"
    y_mm: Length = 0.0
    z_mm: Length
    width_mm: Size
    height_mm: Size
    depth_mm: Size
    rib_mm: Annotated[float, Field(ge=0.0, le=2000.0)] = 0.0


class HolderFile(Versioned):
    """A whole drawing."""

    format: str = KIND
    version: int = VERSION
    name: str = ""
    source: str = ""
    tcp_mm: tuple[float, float, float]
    gauge_mm: Annotated[float, Field(gt=0.1, le=100.0)] = 3.0
    noise_um_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 0.2
    cheeks: CheeksTable
    pockets: Annotated[tuple[PocketTable, ...], Field(max_length=12)] = ()

    @property
    def noise(self) -> float:
        """Standard deviation of a bridge's strain."""
        return self.noise_um_m * MICRO

    def drawing(self, where: str) -> Drawing:
        """The drawing in SI. Raises FileFormatError: cheeks or pockets that cannot be made."""
        c = self.cheeks
        try:
            beam = HolderBeam(
                c.length_mm * MM, c.distance_mm * MM, c.thickness_mm * MM, c.width_mm * MM,
                c.youngs_modulus_gpa * _GPA, c.poisson_ratio,
            )  # fmt: skip
            pockets = []
            for number, p in enumerate(self.pockets, start=1):
                for side in {"both": (-1, 1), "-x": (-1,), "+x": (1,)}[p.cheek]:
                    one = Pocket(
                        side, p.face == "outer", p.y_mm * MM, p.z_mm * MM, p.width_mm * MM, p.height_mm * MM,
                        p.depth_mm * MM, p.rib_mm * MM,
                    )  # fmt: skip
                    one.check(beam, f"[[pockets]] {number}")
                    pockets.append(one)
            x, y, z = (value * MM for value in self.tcp_mm)
            return Drawing(beam, tuple(pockets), (x, y, z), self.gauge_mm * MM)
        except CounterflexError as fault:
            raise FileFormatError(str(fault), where=where) from fault


def read_holder(path: str | Path) -> HolderFile:
    """Read a drawing. Raises FileFormatError: not a drawing, an unknown key, a value out of range."""
    return HolderFile.read(path, kind=KIND, version=VERSION)


def holder_data(file: HolderFile, drawing: Drawing) -> dict[str, Any]:
    """The file with the pockets of another drawing, ready for TOML."""
    data = file.model_dump(mode="json", exclude_defaults=False)
    data["pockets"] = [
        {
            "cheek": "-x" if p.side < 0 else "+x",
            "face": "outer" if p.outer else "inner",
            **{
                key: round(value / MM, 3)
                for key, value in (
                    ("y_mm", p.y_m), ("z_mm", p.z_m), ("width_mm", p.width_m), ("height_mm", p.height_m),
                    ("depth_mm", p.depth_m), ("rib_mm", p.rib_m),
                )
            },
        }
        for p in drawing.pockets
    ]  # fmt: skip
    return data
