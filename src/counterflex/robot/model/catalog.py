"""The robot catalogue: one TOML file per robot in ``catalog_data``, every group of numbers with source and status.

Status words: ``VERIFIED`` two independent sources or measurements agree; ``SECONDARY`` one source, a quotation or a
stated judgement; ``UNVERIFIED`` memory or derivation, never an oracle; ``not known`` nothing found: what is not known
is rigid, or massless.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from counterflex.core.arrays import Float, frozen
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.registry import Registry
from counterflex.core.similar import close_to
from counterflex.core.units import DEG, MM, URAD_PER_KNM
from counterflex.geometry import pose
from counterflex.robot.model import controller_axes
from counterflex.robot.model.description import Counterbalance, Opw, Robot, Segment
from counterflex.robot.model.opw_chain import Element, from_opw

__all__ = [
    "CatalogEntry",
    "Check",
    "Element",
    "Provenance",
    "end_effector_elements",
    "entry",
    "from_opw",
    "load",
    "names",
]

_Six = Annotated[list[float], Field(min_length=6, max_length=6)]
_Three = Annotated[list[float], Field(min_length=3, max_length=3)]
OTHER_ROBOTS: Final[Registry[Path]] = Registry("counterflex.robots", "robot", "pathlib:Path", {})
"""Robots of other packages: the path of a TOML file of the same form (:class:`CatalogEntry`)."""
Status = Literal["VERIFIED", "SECONDARY", "UNVERIFIED", "not known"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Provenance(_Table):
    """Source of a group of numbers, its reliability, and the effect of an assumption in it."""

    status: Status
    source: str
    effect: str = ""


class Check(_Table):
    """A published flange pose: controller angles, position, rotation (rows) of ``T_base_flange``."""

    name: str
    q_deg: _Six
    position_mm: _Three
    rotation: Annotated[list[_Three], Field(min_length=3, max_length=3)]


class _Geometry(_Table):
    a1_mm: float
    a2_mm: float
    b_mm: float
    c1_mm: float
    c2_mm: float
    c3_mm: float
    c4_mm: float
    offsets_deg: _Six
    signs: Annotated[list[Literal[-1, 1]], Field(min_length=6, max_length=6)]


class _Limits(_Table):
    lower_deg: _Six
    upper_deg: _Six
    speed_deg_s: _Six | None = None
    acceleration_deg_s2: _Six | None = None


class _Axis(_Table):
    axis: int = Field(ge=1, le=6)
    bearing_mm: float = 0.0
    compliance_urad_per_knm: _Three = [0.0, 0.0, 0.0]
    mass_kg: float = Field(default=0.0, ge=0.0)
    com_mm: _Three = [0.0, 0.0, 0.0]


class _Element(_Table):
    name: str
    after_axis: int = Field(ge=0, le=6)
    xyz_mm: _Three
    abc_deg: _Three
    compliance_urad_per_knm: _Three = [0.0, 0.0, 0.0]
    mass_kg: float = Field(default=0.0, ge=0.0)
    com_mm: _Three = [0.0, 0.0, 0.0]


class _Counterbalance(_Table):
    axis: int = Field(ge=1, le=6)
    anchor_column_mm: float = Field(gt=0.0)
    anchor_arm_mm: float = Field(gt=0.0)
    angle_of_least_force_deg: float
    piston_diameter_mm: float = Field(gt=0.0)
    rod_diameter_mm: float = Field(ge=0.0)
    gas_mass_kg: float = Field(gt=0.0)
    gas_constant_j_per_kg_k: float = Field(gt=0.0)
    gas_compressibility: float = Field(gt=0.0)
    gas_temperature_k: float = Field(gt=0.0)
    gas_volume_max_m3: float = Field(gt=0.0)


class CatalogEntry(_Table):
    """Content of a catalogue file, as written there (mm, deg, kg, urad/kN m); :func:`load` turns it into a robot."""

    format: Literal["counterflex-robot"]
    version: Literal[1]
    name: str  # catalogue name
    manufacturer: str  # maker
    model: str  # type plate
    payload_kg: float | None = None  # rated payload, where known
    reach_mm: float | None = None  # data-sheet reach, where known
    notes: list[str] = []  # traps and remarks
    # provenance per group: `geometry limits speeds accelerations masses stiffness_about_axes stiffness_tilt
    # stiffness_links stiffness_translation bearings counterbalance`, and `geometry_flange` where the flange distance is
    # less sure than the rest
    sources: dict[str, Provenance]
    geometry: _Geometry  # OPW lengths
    limits: _Limits  # joint limits and speeds in controller angles
    # bearing position, compliance (rx ry rz about the bearing frame, z along the joint), mass, centre of gravity
    axes: list[_Axis] = []
    elements: list[_Element] = []  # elastic bodies between the axes
    counterbalance: _Counterbalance | None = None  # gas cylinder, where known
    checks: list[Check]  # published flange poses
    # what the controller counts axis 3 from; None is the maker's rule, the upper arm where it has none
    axis_3_from: controller_axes.Axis3 | None = None

    @property
    def status(self) -> str:
        """Status of the geometry, the group every use stands on."""
        return self.sources["geometry"].status


class _EndEffectorFile(_Table):
    format: Literal["counterflex-end-effector-elements"]
    version: Literal[1]
    elements: list[_Element]
    sources: dict[str, Provenance]


@dataclass(frozen=True)
class EndEffectorElement:
    """An elastic body of an end effector that a cell file or a demo can quote."""

    segment: Segment  # its frame is given in the flange frame
    provenance: Provenance  # source and status of its compliance
    frame: Provenance  # source and status of the frame's place and axes


def names() -> list[str]:
    """Names of all robots in the catalogue and of other packages (``counterflex.robots``), sorted."""
    return sorted({*_own_names(), *OTHER_ROBOTS})


def _own_names() -> list[str]:
    return [item.name[:-5] for item in _folder().iterdir() if item.name.endswith(".toml")]


def _file(name: str) -> Traversable:
    """File of a robot: one of ours, or the path that another package registers."""
    if name not in OTHER_ROBOTS:
        return _folder() / f"{name}.toml"
    if name in _own_names():
        raise InputError(
            "two packages bring the same robot",
            value=f"'{name}' of counterflex and of {OTHER_ROBOTS.package(name)}",
            hint="Remove one of the packages, or have it rename the entry point",
        )
    file: Path = OTHER_ROBOTS[name]
    return file


@functools.cache
def entry(name: str) -> CatalogEntry:
    """The catalogue file of a robot, read and checked.

    Args:
        name: Catalogue name such as ``kuka_kr300_r2500_ultra``.

    Raises:
        InputError: No such robot; the nearest names are listed.
        FileFormatError: The file breaks the format.
    """
    if name not in names():
        near = close_to(name, names(), 5)
        raise InputError(
            f"no robot {name!r} in the catalogue",
            limit="one of " + ", ".join(near) if near else None,
            hint="'counterflex robots' lists all. Describe another robot by its lengths in the cell file",
            nearest=near,
        )
    source = _file(name)
    try:
        read = CatalogEntry.model_validate(tomllib.loads(source.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, ValidationError, OSError, UnicodeDecodeError) as fault:
        raise FileFormatError(_first(fault), where=source.name) from fault
    if read.name != name:
        raise FileFormatError("the name inside differs from the file name", where=f"{name}.toml", value=read.name)
    return read


@functools.cache
def load(name: str) -> Robot:
    """A robot of the catalogue as a chain of segments, SI units, read-only arrays.

    Args:
        name: Catalogue name.

    Returns:
        The robot; segments are ``axis1`` ... ``axis6`` with the elastic bodies of the file in between. Compliances
        that are not known are zero (rigid), masses that are not known are zero; see :func:`entry` for the status.

    Raises:
        InputError: No such robot.
        FileFormatError: The catalogue file breaks the format.
    """
    e = entry(name)
    g = e.geometry
    opw = Opw(
        a1_m=g.a1_mm * MM,
        a2_m=g.a2_mm * MM,
        b_m=g.b_mm * MM,
        c1_m=g.c1_mm * MM,
        c2_m=g.c2_mm * MM,
        c3_m=g.c3_mm * MM,
        c4_m=g.c4_mm * MM,
        offsets_rad=tuple(o * DEG for o in g.offsets_deg),
        signs=tuple(g.signs),
    )
    compliance, bearing, mass, com = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros((6, 3))
    for row in e.axes:
        joint = row.axis - 1
        compliance[joint] = _six(row.compliance_urad_per_knm)
        bearing[joint] = row.bearing_mm * MM
        mass[joint] = row.mass_kg
        com[joint] = np.array(row.com_mm) * MM
    limits = frozen(np.stack([np.array(e.limits.lower_deg), np.array(e.limits.upper_deg)], axis=1) * DEG)
    robot = from_opw(
        name,
        opw,
        limits,
        compliance,
        bearings_m=bearing,
        masses_kg=mass,
        p_axis_com=com,
        elements=[_element(row) for row in e.elements],
        speeds_rad_s=None if e.limits.speed_deg_s is None else np.array(e.limits.speed_deg_s) * DEG,
        counterbalance=None if e.counterbalance is None else _cylinder(e.counterbalance),
    )
    robot = replace(robot, axes=_controller_axes(e, opw, limits))
    if robot.axes.limits_rad is not None:
        robot = replace(robot, joint_limits_rad=robot.axes.model_limits())
    if e.limits.acceleration_deg_s2 is None:
        return robot
    return replace(robot, joint_accelerations_rad_s2=frozen(np.array(e.limits.acceleration_deg_s2) * DEG))


def _controller_axes(e: CatalogEntry, opw: Opw, limits_rad: Float) -> controller_axes.ControllerAxes:
    title = e.manufacturer.casefold()
    maker = next((name for name, one in controller_axes.MAKERS.items() if one.title.casefold() == title), None)
    maker = maker or controller_axes.maker_of(opw.signs, opw.offsets_rad)
    if maker is None:
        return controller_axes.AS_MODEL
    axis_3 = e.axis_3_from or controller_axes.MAKERS[maker].axis_3 or "upper_arm"
    axes = controller_axes.from_geometry(maker, opw.signs, opw.offsets_rad, opw.c1_m, axis_3)
    return replace(axes, limits_rad=limits_rad) if axes.coupled else axes


def end_effector_elements() -> dict[str, EndEffectorElement]:
    """Elastic bodies beyond the flange with published stiffness: ``haehn2020_sensor``, ``haehn2020_spindle_holder``.

    Haehn2020 Table 1 gives three rotational stiffnesses per element and neither the place nor the axes of its frame;
    ``frame`` of each entry says what is assumed.

    Returns:
        By name; the segment's ``T_prev_seg`` is its pose in the flange frame, compliance in its own axes.
    """
    text = (_folder() / "end_effectors" / "haehn2020.toml").read_text(encoding="utf-8")
    read = _EndEffectorFile.model_validate(tomllib.loads(text))
    out = {}
    for row in read.elements:
        body = _element(row)
        segment = Segment(
            name=row.name,
            T_prev_seg=body.T_axis_elem,
            compliance=body.compliance,
            mass_kg=body.mass_kg,
            p_seg_com=body.p_elem_com,
        )
        out[row.name] = EndEffectorElement(segment, read.sources["stiffness"], read.sources["frame"])
    return out


def _folder() -> Traversable:
    return resources.files("counterflex.robot.model") / "catalog_data"


def _six(rotational_urad_per_knm: list[float]) -> Float:
    return frozen(np.concatenate([np.zeros(3), np.array(rotational_urad_per_knm) * URAD_PER_KNM]))


def _element(row: _Element) -> Element:
    T = pose.from_xyz_zyx(np.array(row.xyz_mm) * MM, np.array(row.abc_deg) * DEG)
    return Element(
        name=row.name,
        after_joint=row.after_axis - 1,
        T_axis_elem=frozen(T),
        compliance=_six(row.compliance_urad_per_knm),
        mass_kg=row.mass_kg,
        p_elem_com=frozen(np.array(row.com_mm) * MM),
    )


def _cylinder(c: _Counterbalance) -> Counterbalance:
    return Counterbalance(
        joint=c.axis - 1,
        anchor_column_m=c.anchor_column_mm * MM,
        anchor_arm_m=c.anchor_arm_mm * MM,
        q_min_force_rad=c.angle_of_least_force_deg * DEG,
        piston_area_m2=np.pi / 4.0 * (c.piston_diameter_mm**2 - c.rod_diameter_mm**2) * MM**2,
        gas_constant_j=c.gas_compressibility * c.gas_constant_j_per_kg_k * c.gas_temperature_k * c.gas_mass_kg,
        gas_volume_max_m3=c.gas_volume_max_m3,
    )


def _first(fault: Exception) -> str:
    if isinstance(fault, ValidationError):
        first = fault.errors()[0]
        return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg']}"
    return str(fault)
