"""Tables of the robot: which one, compliances by region, play, loop gains, errors of its drives, sag of two axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from counterflex.core.errors import InputError
from counterflex.core.similar import twice
from counterflex.core.units import DEG, MM, MRAD, URAD
from counterflex.files.cell.measured import CalibrationTable
from counterflex.files.schema import Angle, ComplianceTable, Length, Table
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.axis_sag import AxisSag
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.drive_error import DriveError, DriveErrors
from counterflex.robot.model.controller_axes import MAKERS, Axis3, ControllerAxes, from_geometry, from_signs, maker_of
from counterflex.robot.model.description import AXES, LOADS, ComplianceCurve, DhRow, ElasticRegion, Robot
from counterflex.robot.model.elastic_region import ANGLES, DIRECTIONS

Mass = Annotated[float, Field(ge=0.0, le=5000.0)]
Factor = Annotated[float, Field(ge=0.1, le=10.0)]
Load = Annotated[float, Field(ge=-1e6, le=1e6)]
MOST_REGIONS: Final = 24
CLOSEST_DEG: Final = 0.1
"""Least distance of two angles: a steeper change would step the correction."""
CLOSEST_LOAD: Final = 0.01
"""Least distance of two loads, N or N m."""


class ElasticRegionTable(Table):
    """Factor on one compliance over the angle of one axis."""

    segment: str
    direction: Literal["tx", "ty", "tz", "rx", "ry", "rz"]
    axis: Annotated[int, Field(ge=1, le=6)]
    angles_deg: Annotated[tuple[Angle, ...], Field(min_length=ANGLES[0], max_length=ANGLES[1])]
    factors: Annotated[tuple[Factor, ...], Field(min_length=ANGLES[0], max_length=ANGLES[1])]
    source: str = ""

    @model_validator(mode="after")
    def _curve(self) -> ElasticRegionTable:
        if len(self.angles_deg) != len(self.factors):
            raise ValueError(
                f"angles_deg has {len(self.angles_deg)} values and factors {len(self.factors)}; "
                "expected one factor for every angle"
            )
        if np.min(np.diff(self.angles_deg)) < CLOSEST_DEG:
            raise ValueError(
                f"angles_deg = {', '.join(f'{a:g}' for a in self.angles_deg)} do not rise by at least {CLOSEST_DEG:g} "
                "each; list them from the lowest to the highest"
            )
        return self

    def region(self) -> ElasticRegion:
        """The same in SI."""
        return ElasticRegion(
            self.segment,
            DIRECTIONS.index(self.direction),
            self.axis - 1,
            tuple(angle * DEG for angle in self.angles_deg),
            self.factors,
        )


class ComplianceCurveTable(Table):
    """Factor on one compliance over the load of its spring."""

    segment: str
    direction: Literal["tx", "ty", "tz", "rx", "ry", "rz"]
    loads_n: Annotated[tuple[Load, ...], Field(min_length=LOADS[0], max_length=LOADS[1])] | None = None
    loads_nm: Annotated[tuple[Load, ...], Field(min_length=LOADS[0], max_length=LOADS[1])] | None = None
    factors: Annotated[tuple[Factor, ...], Field(min_length=LOADS[0], max_length=LOADS[1])]
    source: str = ""

    @model_validator(mode="after")
    def _curve(self) -> ComplianceCurveTable:
        right, wrong = ("loads_n", "loads_nm") if self.direction.startswith("t") else ("loads_nm", "loads_n")
        loads = getattr(self, right)
        if loads is None or getattr(self, wrong) is not None:
            raise ValueError(f"the loads of {self.direction} are given as {right}")
        if len(loads) != len(self.factors):
            raise ValueError(
                f"{right} has {len(loads)} values and factors {len(self.factors)}; expected one factor for every load"
            )
        if np.min(np.diff(loads)) < CLOSEST_LOAD:
            raise ValueError(
                f"{right} = {', '.join(f'{x:g}' for x in loads)} do not rise by at least {CLOSEST_LOAD:g} each; list "
                "them from the lowest to the highest"
            )
        return self

    def curve(self) -> ComplianceCurve:
        """The same in SI."""
        loads = self.loads_n or self.loads_nm or ()
        return ComplianceCurve(self.segment, DIRECTIONS.index(self.direction), loads, self.factors)


class DhRowTable(Table):
    """One axis: ``theta = sign q + offset``, and the body that it carries."""

    a_mm: Length = 0.0
    d_mm: Length = 0.0
    alpha_deg: Angle = 0.0
    offset_deg: Angle = 0.0
    sign: Literal[-1, 1] = 1
    limits_deg: tuple[Angle, Angle]
    mass_kg: Mass = 0.0
    com_x_mm: Length = 0.0
    com_y_mm: Length = 0.0
    com_z_mm: Length = 0.0


class DhTable(Table):
    """Six axes from the base outward."""

    convention: Literal["standard", "modified"] = "standard"
    axes: Annotated[list[DhRowTable], Field(min_length=AXES, max_length=AXES)]

    def robot(self, name: str) -> Robot:
        """The robot in SI."""
        rows = [
            DhRow(
                a_m=row.a_mm * MM,
                d_m=row.d_mm * MM,
                alpha_rad=row.alpha_deg * DEG,
                offset_rad=row.offset_deg * DEG,
                sign=float(row.sign),
                limits_rad=(row.limits_deg[0] * DEG, row.limits_deg[1] * DEG),
                mass_kg=row.mass_kg,
                p_axis_com=(row.com_x_mm * MM, row.com_y_mm * MM, row.com_z_mm * MM),
            )
            for row in self.axes
        ]
        return Robot.from_dh(name, rows, self.convention)


MAX_SLIP_ELEMENTS: Final = 3


class OpwTable(Table):
    """Own geometry of a six-axis arm with parallel base and spherical wrist."""

    a1_mm: Length
    a2_mm: Length
    b_mm: Length = 0.0
    c1_mm: Length
    c2_mm: Length
    c3_mm: Length
    c4_mm: Length
    offsets_deg: Annotated[list[Angle], Field(min_length=6, max_length=6)]
    signs: Annotated[list[Literal[-1, 1]], Field(min_length=6, max_length=6)]
    limits_deg: Annotated[list[tuple[Angle, Angle]], Field(min_length=6, max_length=6)]


class ElasticTable(ComplianceTable):
    """Replaces entries of the compliance (and the mass) of one segment of the robot."""

    segment: str
    mass_kg: Mass | None = None
    source: str = ""


class PlayTable(Table):
    """Gear play and dry friction of one axis, as slow reversals of the unloaded axis show them."""

    axis: Annotated[int, Field(ge=1, le=6)]
    dead_band_half_urad: Annotated[float, Field(ge=0.0, le=10_000.0)] = 0.0
    friction_nm: tuple[Annotated[float, Field(ge=0.0, le=100_000.0)], ...] = ()
    slip_urad: tuple[Annotated[float, Field(ge=0.1, le=10_000.0)], ...] = ()
    source: str = ""

    @model_validator(mode="after")
    def _elements(self) -> PlayTable:
        if len(self.friction_nm) != len(self.slip_urad):
            raise ValueError(
                f"friction_nm has {len(self.friction_nm)} values and slip_urad {len(self.slip_urad)}; "
                "expected one slip angle for every friction torque"
            )
        if len(self.friction_nm) > MAX_SLIP_ELEMENTS:
            raise ValueError(
                f"friction_nm has {len(self.friction_nm)} values; expected at most {MAX_SLIP_ELEMENTS} slip elements"
            )
        return self


class ServoTable(Table):
    """Loop gains of one axis, on the link side, as the controller's machine data or a load step show them."""

    axis: Annotated[int, Field(ge=1, le=6)]
    speed_gain_nm_s: Annotated[float, Field(ge=1e-3, le=1e9)]
    position_gain_per_s: Annotated[float, Field(ge=0.1, le=1e4)]
    integral_time_ms: Annotated[float, Field(ge=0.1, le=1e5)]
    friction_nm: Annotated[float, Field(ge=0.0, le=100_000.0)] = 0.0
    slip_urad: Annotated[float, Field(ge=0.1, le=10_000.0)] = 10.0
    source: str = ""


Sign = Literal[-1, 1]
SixSigns = tuple[Sign, Sign, Sign, Sign, Sign, Sign]
SixAngles = tuple[Angle, Angle, Angle, Angle, Angle, Angle]
Ratio = Annotated[float, Field(ge=1.0, le=1e6)]
SixRatios = tuple[Ratio, Ratio, Ratio, Ratio, Ratio, Ratio]


def _known_maker(name: str) -> str:
    if name not in MAKERS:
        raise ValueError(f"no known maker of controllers: {name}; expected {', '.join(MAKERS)}")
    return name


KnownMaker = Annotated[str, AfterValidator(_known_maker)]


class ControllerAxesTable(Table):
    """Axis convention of the controller, for a robot that the cell file describes itself."""

    maker: KnownMaker | None = None
    axis_3_from: Axis3 | None = None
    axis_3_to_upper_arm_deg: tuple[Angle, Angle] | None = None
    world_z_mm: Length | None = None
    signs: SixSigns | None = None
    zeros_deg: SixAngles | None = None
    pulses_per_deg: SixRatios | None = None

    def axes(self, robot: Robot) -> ControllerAxes:
        """The axes of a robot, without limits of their own.

        Raises:
            InputError: Neither the table nor the geometry says which maker's controller it is.
        """
        opw, maker = robot.opw, self.maker
        own = self.signs is not None or self.zeros_deg is not None
        if maker is None and opw is not None and not own:
            maker = maker_of(opw.signs, opw.offsets_rad)
        if maker is None:
            raise InputError("whose controller it is, is not known", value="maker", limit=", ".join(MAKERS),
                             hint="Give maker")  # fmt: skip
        if opw is not None and not own:
            axes = from_geometry(maker, opw.signs, opw.offsets_rad, opw.c1_m, self.axis_3_from)
        else:
            zeros = tuple(float(value) * DEG for value in self.zeros_deg or (0.0,) * 6)
            axes = from_signs(maker, self.signs or (1,) * 6, zeros, axis_2_height(robot), self.axis_3_from)
        return axes if self.world_z_mm is None else replace(axes, world_m=self.world_z_mm * MM)


def axis_2_height(robot: Robot) -> float:
    """Height of axis 2 above the base plate with all angles at zero, m."""
    T = np.eye(4)
    for segment in robot.segments:
        T = T @ segment.T_prev_seg
        if segment.joint == 1:
            break
        if segment.joint is not None:
            T = T @ pose.make(rotation.about_z(segment.offset_rad))
    return float(T[2, 3])


class RobotTable(Table):
    """Robot by catalogue name, by own geometry, by Denavit-Hartenberg rows, or from a URDF file."""

    catalog: str | None = None
    geometry: OpwTable | None = None
    dh: DhTable | None = None
    urdf: str | None = None
    urdf_tip: str | None = None
    payload_kg: Annotated[float, Field(gt=0.0, le=5000.0)] | None = None
    controller_axes: ControllerAxesTable | None = None
    elastic: tuple[ElasticTable, ...] = ()
    elastic_region: Annotated[tuple[ElasticRegionTable, ...], Field(max_length=MOST_REGIONS)] = ()
    compliance_curve: Annotated[tuple[ComplianceCurveTable, ...], Field(max_length=MOST_REGIONS)] = ()
    play: tuple[PlayTable, ...] = ()
    servo: tuple[ServoTable, ...] = ()
    calibration: tuple[CalibrationTable, ...] = ()

    @model_validator(mode="after")
    def _one_table_each(self) -> RobotTable:
        stated: tuple[tuple[str, Sequence[int | str]], ...] = (
            ("play of axis", [row.axis for row in self.play]),
            ("servo of axis", [row.axis for row in self.servo]),
            ("calibration of", [row.segment for row in self.calibration]),
        )
        for what, names in stated:
            if (name := twice(names)) is not None:
                raise ValueError(f"{what} {name} is given {names.count(name)} times; expected once")
        return self

    @model_validator(mode="after")
    def _one_source(self) -> RobotTable:
        given = [key for key in ("catalog", "geometry", "dh", "urdf") if getattr(self, key) is not None]
        if len(given) != 1:
            result = " and ".join(given) or "none of them"
            raise ValueError(f"a robot comes from exactly one of catalog, geometry, dh and urdf; got {result}")
        if self.catalog is not None and self.controller_axes is not None:
            raise ValueError("controller_axes is for a robot that the file describes; the catalogue has its own")
        if self.urdf is None and self.urdf_tip is not None:
            raise ValueError(f"urdf_tip names a link of urdf; the robot comes from {given[0]}")
        return self


Order = Annotated[int, Field(ge=1, le=1000)]
Amplitude = Annotated[float, Field(ge=-1e5, le=1e5)]
Harmonics = Annotated[tuple[tuple[Order, Amplitude, Amplitude], ...], Field(max_length=200)]
"""Rows ``[order, sine amplitude in urad, cosine amplitude in urad]``."""
Ranges = Annotated[tuple[tuple[Angle, Angle], ...], Field(max_length=6)]
"""Lowest and highest angle of each of the six axes."""


class DriveErrorTable(Table):
    """Harmonics of the six drives; an axis that is left out has none."""

    axis1: Harmonics = ()
    axis2: Harmonics = ()
    axis3: Harmonics = ()
    axis4: Harmonics = ()
    axis5: Harmonics = ()
    axis6: Harmonics = ()
    measured_deg: Ranges = ()
    source: str = ""

    def errors(self) -> DriveErrors:
        """The errors in SI. Raises :class:`ModelError` where they are far too large."""
        rows = (self.axis1, self.axis2, self.axis3, self.axis4, self.axis5, self.axis6)
        return DriveErrors(
            tuple(
                DriveError(axis, order, sine * URAD, cosine * URAD)
                for axis, harmonics in enumerate(rows)
                for order, sine, cosine in harmonics
            ),
            tuple((low * DEG, high * DEG) for low, high in self.measured_deg),
        )


Moment = Annotated[float, Field(ge=-1e3, le=1e3)]
Pair = tuple[Moment, Moment]
"""Along x and y of the link's segment, mrad."""


class AxisSagTable(Table):
    """Compliance of an axis times the weight's first moment of what it carries."""

    axis2_by_link2_mrad: Pair = (0.0, 0.0)
    axis2_by_link3_mrad: Pair = (0.0, 0.0)
    axis3_by_link3_mrad: Pair = (0.0, 0.0)
    source: str = ""

    def sag(self, chain: ElasticChain) -> AxisSag:
        """The same in SI, on a chain. Raises :class:`ModelError` where the numbers are far too large."""
        rows = (self.axis2_by_link2_mrad, self.axis2_by_link3_mrad, self.axis3_by_link3_mrad)
        return AxisSag(chain, np.array(rows, dtype=np.float64).ravel() * MRAD)
