"""The tables of a cell file (``counterflex-cell``, version 1). docs/cell-file.md explains every key."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from counterflex.core.errors import CounterflexError
from counterflex.core.similar import twice
from counterflex.core.units import DEG, MM, RPM
from counterflex.cutting.force_laws import FORCE_LAWS, require_parameters
from counterflex.files.cell.bodies import SurroundingsTable
from counterflex.files.cell.controller import ControllerTable
from counterflex.files.cell.external_axes import ExternalAxisTable
from counterflex.files.cell.links import AdsTable, EgmTable
from counterflex.files.cell.machine import MachineTable, ProcessLimitsTable
from counterflex.files.cell.measured import IdentifiedTable
from counterflex.files.cell.monitor import MonitorTable, OverrideTable
from counterflex.files.cell.online import OnlineTable, TimingTable
from counterflex.files.cell.planning import DynamicsTable, LimitsTable, PostureTable
from counterflex.files.cell.robot import AxisSagTable, DriveErrorTable, Mass, RobotTable
from counterflex.files.cell.sensing import HolderTable, SensorTable, TrackerTable
from counterflex.files.schema import ComplianceTable, Length, PoseTable, Table, Versioned
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.programs.limits import RESERVED

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Vector = tuple[Length, Length, Length]
WorkOffsetName = Annotated[str, Field(pattern=r"^G(5[4-9]|59\.[1-3]|54\.1 P\d{1,3}|5\d\d)$")]
"""A work offset of G-code (``G54.1 P3``: also G154 P3) or a settable offset of Sinumerik (``G505``)."""
Share = Annotated[float, Field(ge=0.0, le=5.0)]
ToolLength = Annotated[float, Field(gt=0.0, le=1000.0)]
Pressure = Annotated[float, Field(ge=0.0, le=20000.0)]
EdgeForce = Annotated[float, Field(ge=0.0, le=1000.0)]
MIN_CELLS: Final = 16
MAX_CELLS: Final = 200_000_000
SignedShare = Annotated[float, Field(ge=-5.0, le=5.0)]
_NEEDED: Final = {
    "kienzle": ("kc11_n_mm2", "mc", "kr_over_kc", "ka_over_kc"),
    "linear_edge": ("ktc_n_mm2", "krc_n_mm2"),
}
_READ: Final = {
    "kienzle": (
        "edge_c_n_mm",
        "edge_r_n_mm",
        "edge_a_n_mm",
        "kc11_n_mm2",
        "mc",
        "kr_over_kc",
        "mr",
        "ka_over_kc",
        "ma",
    ),
    "linear_edge": ("ktc_n_mm2", "krc_n_mm2", "kac_n_mm2", "kte_n_mm", "kre_n_mm", "kae_n_mm"),
}
"""Keys of our own force laws."""


class BodyTable(PoseTable, ComplianceTable):
    """One body of the end effector; its pose is given in the previous body (the flange for the first)."""

    name: str
    mass_kg: Mass = 0.0
    com_x_mm: Length = 0.0
    com_y_mm: Length = 0.0
    com_z_mm: Length = 0.0
    source: str = ""


class ToolTable(Table):
    """A milling tool."""

    number: Annotated[int, Field(ge=0)]
    name: str = ""
    diameter_mm: ToolLength
    corner_radius_mm: NonNegative = 0.0
    flutes: Annotated[int, Field(ge=1, le=64)]
    helix_deg: Annotated[float, Field(ge=0.0, lt=80.0)] = 30.0
    flute_length_mm: ToolLength
    runout_um: NonNegative = 0.0
    overhang_mm: ToolLength | None = None
    modulus_gpa: Annotated[float, Field(ge=50.0, le=1200.0)] | None = None
    longer_mm: Annotated[float, Field(ge=-1000.0, le=1000.0)] = 0.0
    heavier_kg: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    tool_data: Annotated[int, Field(ge=1, le=128)] | None = None
    spindle_rpm: Annotated[float, Field(gt=0.0, le=200_000.0)] | None = None
    tooldata: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")] | None = None
    centre_cutting: bool | None = None
    ramp_deg: Annotated[float, Field(gt=0.0, le=90.0)] | None = None
    feed_per_tooth_mm: tuple[ToolLength, ToolLength] | None = None
    cutting_speed_m_min: tuple[Positive, Positive] | None = None
    max_rpm: Annotated[float, Field(gt=0.0, le=200_000.0)] | None = None
    coolant: bool | None = None
    holder_mm: Annotated[tuple[tuple[NonNegative, ToolLength], ...], Field(max_length=64)] = ()

    @property
    def bounds(self) -> ToolBounds:
        """Limits of the tool, and its holder, in SI; None is not known."""
        feed, speed = self.feed_per_tooth_mm, self.cutting_speed_m_min
        return ToolBounds(
            centre_cutting=self.centre_cutting,
            ramp_rad=None if self.ramp_deg is None else self.ramp_deg * DEG,
            feed_per_tooth_m=None if feed is None else (feed[0] * MM, feed[1] * MM),
            cutting_speed_m_s=None if speed is None else (speed[0] / 60.0, speed[1] / 60.0),
            max_rad_s=None if self.max_rpm is None else self.max_rpm * RPM,
            coolant=self.coolant,
            holder_m=tuple((height * MM, 0.5 * diameter * MM) for height, diameter in self.holder_mm),
        )

    @property
    def overhang_m(self) -> float | None:
        """Length out of the holder, m; None where it is not known."""
        return None if self.overhang_mm is None else self.overhang_mm * MM

    @field_validator("tooldata")
    @classmethod
    def _no_word_of_rapid(cls, name: str | None) -> str | None:
        if name is not None and name.upper() in RESERVED | {"TOOL0"}:
            raise ValueError(f"{name} is a word of RAPID or the bare flange; expected the name of this tool's tooldata")
        return name

    @model_validator(mode="after")
    def _shape(self) -> ToolTable:
        radius_mm = 0.5 * self.diameter_mm
        if self.corner_radius_mm > radius_mm:
            raise ValueError(
                f"corner_radius_mm = {self.corner_radius_mm:g} does not fit diameter_mm = {self.diameter_mm:g}; "
                f"expected at most {radius_mm:g}"
            )
        if self.runout_um > 100.0 * radius_mm:
            raise ValueError(
                f"runout_um = {self.runout_um:g} is implausibly large; expected at most {100.0 * radius_mm:g}"
            )
        if self.corner_radius_mm > self.flute_length_mm:
            raise ValueError(f"the flutes end within the corner radius: flute_length_mm = {self.flute_length_mm:g}")
        for key in ("feed_per_tooth_mm", "cutting_speed_m_min"):
            given = getattr(self, key)
            if given is not None and given[0] >= given[1]:
                raise ValueError(f"{key} = [{given[0]:g}, {given[1]:g}] does not rise; expected [least, most]")
        heights = [height for height, _ in self.holder_mm]
        if len(heights) == 1 or any(above < below for below, above in itertools.pairwise(heights)):
            raise ValueError(
                "holder_mm is the outline of what does not cut, from the tip upward: at least two points "
                "[height above the tip, diameter], their heights not falling"
            )
        return self


class MaterialTable(Table):
    """Workpiece material and the cutting law used for it."""

    catalog: str | None = None
    name: str = ""
    law: Annotated[str, Field(min_length=1)] = "kienzle"
    parameters: dict[str, float] = Field(default_factory=dict)
    kc11_n_mm2: Annotated[float, Field(gt=0.0, le=20000.0)] | None = None
    mc: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    kr_over_kc: Share | None = None
    mr: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    ka_over_kc: SignedShare | None = None
    ma: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    edge_c_n_mm: NonNegative = 0.0
    edge_r_n_mm: NonNegative = 0.0
    edge_a_n_mm: NonNegative = 0.0
    ktc_n_mm2: Pressure | None = None
    krc_n_mm2: Pressure | None = None
    kac_n_mm2: Pressure | None = None
    kte_n_mm: EdgeForce | None = None
    kre_n_mm: EdgeForce | None = None
    kae_n_mm: EdgeForce | None = None
    chip_min_um: Positive = 1.0
    chip_max_um: Positive = 1000.0
    allow_extrapolation: bool = False
    source: str = ""

    @field_validator("law")
    @classmethod
    def _known(cls, law: str) -> str:
        try:
            _ = FORCE_LAWS[law]
        except CounterflexError as fault:
            raise ValueError(str(fault)) from fault
        return law

    @model_validator(mode="after")
    def _complete(self) -> MaterialTable:
        read = {"catalog", "name", "source", "allow_extrapolation"}
        if self.catalog is not None:
            what = "a catalog material brings its own constants: remove {}, or remove catalog"
            read |= {"kr_over_kc", "ka_over_kc"}
        else:
            own = () if self._has_parameters else _READ[self.law]
            what = f"the {self.law} law reads {'other keys' if own else '[material.parameters]'}: remove {{}}"
            read |= {"law", "parameters", "chip_min_um", "chip_max_um", *own}
        for key, field in type(self).model_fields.items():
            if key not in read and getattr(self, key) != field.get_default(call_default_factory=True):
                raise ValueError(what.format(key))
        if self.catalog is not None:
            return self
        require_parameters(self.law, FORCE_LAWS[self.law], self.parameters)
        missing = [key for key in _NEEDED.get(self.law, ()) if getattr(self, key) is None]
        if missing:
            raise ValueError(f"the {self.law} law needs {missing[0]} (or a catalog material)")
        return self

    @property
    def _has_parameters(self) -> bool:
        """The law's keys stand in ``[material.parameters]``, not in ``[material]`` itself."""
        return self.law not in FORCE_LAWS.own or bool(FORCE_LAWS[self.law].ranges)

    def law_values(self) -> dict[str, float]:
        """The numbers of the force law by key, in the units that the keys name."""
        if self._has_parameters:
            return self.parameters
        return {key: value for key in _READ[self.law] if (value := getattr(self, key)) is not None}


class StockTable(Table):
    """The blank, in the part frame: a box, an STL mesh, or the result of an earlier run."""

    box_min_mm: Vector | None = None
    box_max_mm: Vector | None = None
    stl: str | None = None
    result: str | None = None
    cell_mm: Annotated[float, Field(gt=0.001, le=5.0)] = 0.1

    @model_validator(mode="after")
    def _one_source(self) -> StockTable:
        box = self.box_min_mm is not None and self.box_max_mm is not None
        if (self.box_min_mm is None) != (self.box_max_mm is None):
            raise ValueError("a box needs box_min_mm and box_max_mm")
        if box and any(low >= high for low, high in zip(self.box_min_mm or [], self.box_max_mm or [], strict=True)):
            raise ValueError("box_min_mm must lie below box_max_mm in x, y and z")
        if sum((box, self.stl is not None, self.result is not None)) != 1:
            raise ValueError("the blank is exactly one of box_min_mm with box_max_mm, stl and result")
        if box:
            self._check_cells()
        return self

    def _check_cells(self) -> None:
        low, high = self.box_min_mm or (), self.box_max_mm or ()
        counts = [math.ceil((b - a) / self.cell_mm) for a, b in list(zip(low, high, strict=True))[:2]]
        if min(counts) < MIN_CELLS:
            raise ValueError(
                f"cell_mm = {self.cell_mm:g} is too coarse for this box: {counts[0]} x {counts[1]} cells; "
                f"expected at least {MIN_CELLS} each way"
            )
        if counts[0] * counts[1] > MAX_CELLS:
            raise ValueError(
                f"cell_mm = {self.cell_mm:g} is too fine for this box: {counts[0]} x {counts[1]} cells; "
                f"expected at most {MAX_CELLS:.0e} in all. Choose a larger cell_mm, or check the unit of the box"
            )


class PartTable(PoseTable):
    """The part frame (program zero) in the robot base, and how that frame was measured.

    With ``part_on = "flange"`` the pose is that in the last body of the end effector.
    """

    measured_with: Literal["robot", "external"] = "robot"
    datum_points_mm: Annotated[tuple[Vector, ...], Field(max_length=100)] = ()
    stock: StockTable | None = None
    work_offsets_mm: Annotated[dict[WorkOffsetName, Vector], Field(max_length=400)] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _datum(self) -> PartTable:
        if self.measured_with == "robot" and len(self.datum_points_mm) < 3:
            raise ValueError('measured_with = "robot" needs at least three datum_points_mm (where the robot touched)')
        if self.measured_with == "robot" and _on_one_line(self.datum_points_mm):
            raise ValueError("the datum_points_mm lie on one line and define no frame; touch a point off that line")
        return self


def _on_one_line(points: tuple[Vector, ...]) -> bool:
    """Return whether all points lie within 1 mm of one line."""
    spread = np.array(points) - np.mean(points, axis=0)
    return bool(np.linalg.svd(spread, compute_uv=False)[1] < 1.0)


class CellTables(Versioned):
    """A whole cell file; ``part``, ``tools`` and ``material`` may be left out where nothing is milled (calibration)."""

    name: Annotated[str, Field(min_length=1)]
    part_on: Literal["table", "flange"] = "table"
    robot: RobotTable
    end_effector: tuple[BodyTable, ...] = ()
    tcp: PoseTable
    part: PartTable | None = None
    external_axes: Annotated[tuple[ExternalAxisTable, ...], Field(max_length=6)] = ()
    tools: tuple[ToolTable, ...] = ()
    material: MaterialTable | None = None
    machine: MachineTable | None = None
    posture: PostureTable = PostureTable()
    controller: ControllerTable = ControllerTable()
    dynamics: DynamicsTable = DynamicsTable()
    limits: LimitsTable = LimitsTable()
    process_limits: ProcessLimitsTable = ProcessLimitsTable()
    cell: SurroundingsTable = SurroundingsTable()
    sensor: SensorTable | None = None
    holder: HolderTable | None = None
    tracker: TrackerTable | None = None
    drive_error: DriveErrorTable | None = None
    axis_sag: AxisSagTable | None = None
    timing: TimingTable | None = None
    online: OnlineTable | None = None
    ads: AdsTable | None = None
    egm: EgmTable | None = None
    monitor: MonitorTable | None = None
    override: OverrideTable | None = None
    identified: tuple[IdentifiedTable, ...] = ()

    @model_validator(mode="after")
    def _unique(self) -> CellTables:
        if (number := twice([tool.number for tool in self.tools])) is not None:
            raise ValueError(f"two tools have the number {number}; tool numbers must differ")
        if (axis := twice([axis.name for axis in self.external_axes])) is not None:
            raise ValueError(f"two external axes are named {axis}")
        if self.tracker is not None and any(axis.carries == "robot" and axis.shown for axis in self.external_axes):
            raise ValueError(
                "the robot stands elsewhere than where [tracker] was measured; measure the tracker with the robot "
                "there, make that the zero of the axis (at_mm = 0), and give part and bodies as seen from there"
            )
        self._check_held_part()
        if (body := twice([body.name for body in self.end_effector])) is not None:
            raise ValueError(f"two bodies of the end effector are named '{body}'; names must differ")
        return self

    def _check_held_part(self) -> None:
        if self.part_on == "table":
            return
        if self.part is None:
            raise ValueError('part_on = "flange" needs [part]: where the part is in the last body of the end effector')
        if self.part.measured_with == "robot":
            raise ValueError(
                'a part that the robot holds is measured from outside; part_on = "flange" needs '
                'part.measured_with = "external" and no datum_points_mm'
            )
        if any(axis.carries == "part" for axis in self.external_axes):
            raise ValueError('the robot carries the part (part_on = "flange"); no external axis can carry it')
        if any(axis.coupled or axis.moves for axis in self.external_axes):
            raise ValueError(
                'the robot carries the part (part_on = "flange"); its external axes stand all along, and frames are '
                "given from where they stand: take coupled and moves_mm out"
            )
