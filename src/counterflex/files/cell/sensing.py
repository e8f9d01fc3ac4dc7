"""Tables ``[sensor]``, ``[holder]`` and ``[tracker]`` of a cell file: what it measures with, in shop units."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError
from counterflex.core.units import DEG, KN, MICRO, MINUTE, MM, N_PER_MM2, PERCENT, UM, URAD
from counterflex.files.schema import Angle, Length, PoseTable, Table
from counterflex.geometry import pose
from counterflex.protocols.force.frame_format import FrameField, FrameFormat
from counterflex.protocols.force.sensors import link_values
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.sensing.carrier import hose_place, mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.strain_holder import Gauge, HolderBeam, StrainHolder

if TYPE_CHECKING:
    from counterflex.protocols.frame.link import FrameSource


Hex = Annotated[str, Field(pattern=r"^([0-9a-fA-F]{2})*$", max_length=128)]

Bits = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]
Counts = Annotated[float, Field(gt=0.0, le=1e12)]


class FrameTable(Table):
    """One frame: bytes as hexadecimal digits, fields as ``"TYPE NAME"`` in their order."""

    transport: Literal["udp", "tcp"] = "udp"
    start: Hex = ""
    stop: Hex = ""
    request: Hex = ""
    header: Hex = ""
    footer: Hex = ""
    byte_order: Literal["little", "big"]
    fields: Annotated[tuple[str, ...], Field(min_length=6, max_length=64)]
    counts_per_n: Counts | None = None
    counts_per_nm: Counts | None = None
    matrix: tuple[Six, Six, Six, Six, Six, Six] | None = None
    crc_from: Annotated[int, Field(ge=0, le=511)] = 0
    saturated_bits: Bits = 0
    invalid_bits: Bits = 0

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.matrix is not None and (self.counts_per_n is not None or self.counts_per_nm is not None):
            raise ValueError("matrix excludes counts_per_n and counts_per_nm; put the counts into the matrix")
        if (self.counts_per_n is None) != (self.counts_per_nm is None):
            raise ValueError("counts_per_n and counts_per_nm belong together; give both or none")
        if self.matrix is None and any(" ch" in text for text in self.fields):
            raise ValueError("channels ch1 .. ch6 need a matrix; components are named fx fy fz mx my mz")
        try:
            self.source()
        except CounterflexError as fault:
            raise ValueError(str(fault)) from fault
        return self

    def source(self) -> FrameSource:
        """Frames and how they are had. Raises InputError: fields, matrix or transport that cannot be."""
        from counterflex.protocols.frame.link import FrameSource

        fields = []
        for text in self.fields:
            kind, _, name = text.partition(" ")
            fields.append(FrameField(kind, name))
        counts = np.repeat([self.counts_per_n or 1.0, self.counts_per_nm or 1.0], 3)
        frame = FrameFormat(
            tuple(fields),
            np.diag(1.0 / counts) if self.matrix is None else np.array(self.matrix),
            bytes.fromhex(self.header),
            bytes.fromhex(self.footer),
            self.byte_order == "little",
            self.crc_from,
            self.saturated_bits,
            self.invalid_bits,
        )
        hexes = (bytes.fromhex(value) for value in (self.start, self.stop, self.request))
        return FrameSource(frame, self.transport, *hexes)


Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
Slew = Annotated[float, Field(gt=0.0, le=1e6)]
Error = Annotated[float, Field(ge=0.0, le=100.0)]
_HOUR = 60.0 * MINUTE
_GPA = KN * N_PER_MM2
UNKNOWN_ERROR = 0.05
"""Share by which a force is off where identify holder has not stated it."""
PROTOCOL = "netft"
"""Of a force sensor whose table names none."""
_SHAPE = "expected 0, 9 or 34 rows of six numbers"


class SensorTable(PoseTable):
    """The six-axis force sensor; its pose is that of the sensor frame in the body that carries it."""

    segment: Annotated[str, Field(min_length=1)]
    mass_kg: Annotated[float, Field(ge=0.0, le=5000.0)] | None = None
    com_mm: Three | None = None
    inertia_kg_m2: Six | None = None
    bias_n: Three = (0.0, 0.0, 0.0)
    bias_nm: Three = (0.0, 0.0, 0.0)
    drift_n_per_h: Three = (0.0, 0.0, 0.0)
    drift_nm_per_h: Three = (0.0, 0.0, 0.0)
    temperature_n_per_k: Three = (0.0, 0.0, 0.0)
    temperature_nm_per_k: Three = (0.0, 0.0, 0.0)
    reference_c: Annotated[float, Field(ge=-50.0, le=150.0)] = 20.0
    offset: tuple[Six, ...] = ()
    hose_from: str = ""
    range_n: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    range_nm: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    protocol: Annotated[str, Field(min_length=1)] = PROTOCOL
    link: dict[str, bool | int | float | str] = Field(default_factory=dict)
    frame: FrameTable | None = None
    source: str = ""

    @model_validator(mode="after")
    def _both(self) -> Self:
        try:
            link_values(self.protocol, self.link)
        except CounterflexError as fault:
            raise ValueError(str(fault)) from fault
        if (self.protocol == "frame") != (self.frame is not None):
            raise ValueError('protocol = "frame" and a table [sensor.frame] belong together')
        if (self.mass_kg is None) != (self.com_mm is None):
            raise ValueError("mass_kg and com_mm of the load behind the sensor belong together; give both or none")
        if len(self.offset) not in (0, 9, 34):
            raise ValueError(f"offset has {len(self.offset)} rows; {_SHAPE}")
        return self


class GaugeTable(Table):
    """One strain-gauge bridge: where its active gauges sit on the holder, and which way they look."""

    x_mm: Length
    y_mm: Length
    z_mm: Length
    angle_deg: Angle = 0.0
    factor: Annotated[float, Field(gt=0.0, le=20.0)] = 1.0


class HolderTable(Table):
    """The instrumented spindle holder: two cheeks between the clamped end and the spindle, and its bridges.

    The holder frame: z along the cheeks from the clamped end to the spindle, x through both cheeks, y across.
    """

    length_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    cheek_distance_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    cheek_thickness_mm: Annotated[float, Field(gt=0.5, le=500.0)]
    cheek_width_mm: Annotated[float, Field(gt=1.0, le=2000.0)]
    youngs_modulus_gpa: Annotated[float, Field(gt=1.0, le=1000.0)] = 210.0
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.3
    segment: str = ""
    gauges: Annotated[tuple[GaugeTable, ...], Field(min_length=3, max_length=12)]
    tcp_mm: Three
    sensitivity_um_m_per_kn: tuple[Six, ...] = ()
    bias_um_m: tuple[float, ...] = ()
    temperature_um_m_per_k: tuple[float, ...] = ()
    reference_c: Annotated[float, Field(ge=-50.0, le=150.0)] = 20.0
    noise_um_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 0.2
    wander_um_m: Annotated[float, Field(gt=0.0, le=100.0)] = 0.02
    zero_um_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    range_um_m: Annotated[float, Field(gt=0.0, le=1e5)] = 1500.0
    slew_n: tuple[Slew, Slew, Slew] | None = None
    most_sigma_n: Annotated[float, Field(gt=0.0, le=1e4)] = 60.0
    error_percent: tuple[tuple[Error, Error, Error], ...] = ()
    source: str = ""

    @model_validator(mode="after")
    def _rows(self) -> Self:
        n = len(self.gauges)
        for key in ("sensitivity_um_m_per_kn", "bias_um_m", "temperature_um_m_per_k"):
            result = len(getattr(self, key))
            if result not in (0, n):
                raise ValueError(f"{key} has {result} rows; expected one for each of the {n} gauges, or none")
        if len(self.error_percent) not in (0, 3):
            raise ValueError(
                f"error_percent has {len(self.error_percent)} rows; expected three, of x, y and z, or none"
            )
        return self

    @property
    def error_share(self) -> Float:
        """(3, 3) standard deviation of the force shown along x, y, z (rows) by 1 N along x, y, z (columns)."""
        out: Float = np.array(self.error_percent).reshape(-1, 3) * PERCENT
        return out if len(out) else UNKNOWN_ERROR * np.eye(3)


def flange_sensor(table: SensorTable | None, chain: ElasticChain) -> FlangeSensor | None:
    """The sensor of a cell in SI.

    Args:
        table: Of the file; None where the cell has no sensor.
        chain: Of the cell: what the file does not say of mass and centre of gravity is that of the bodies behind.

    Returns:
        The sensor, or None.

    Raises:
        InputError: The end effector has no such body, or the hose pack cannot come from where it is said to.
    """
    if table is None:
        return None
    T_seg_sensor = table.matrix()
    R, p = T_seg_sensor[:3, :3], T_seg_sensor[:3, 3]
    mass_kg, p_seg_com = mass_behind(chain, table.segment)
    if table.hose_from:
        hose_place(chain, table.hose_from, table.segment)
    p_sensor_com: Float = R.T @ (p_seg_com - p)
    if table.mass_kg is not None and table.com_mm is not None:
        mass_kg, p_sensor_com = table.mass_kg, np.array(table.com_mm) * MM
    return FlangeSensor(
        segment=table.segment,
        T_seg_sensor=T_seg_sensor,
        mass_kg=mass_kg,
        p_sensor_com=p_sensor_com,
        w_bias=np.array([*table.bias_n, *table.bias_nm]),
        w_drift_per_s=np.array([*table.drift_n_per_h, *table.drift_nm_per_h]) / _HOUR,
        w_kelvin=np.array([*table.temperature_n_per_k, *table.temperature_nm_per_k]),
        reference_c=table.reference_c,
        w_offset=np.array(table.offset).reshape(-1, 6),
        inertia_kg_m2=np.array(table.inertia_kg_m2) if table.inertia_kg_m2 is not None else np.zeros(6),
        hose_from=table.hose_from,
    )


def strain_holder(table: HolderTable | None) -> StrainHolder | None:
    """The instrumented holder of a cell in SI.

    Args:
        table: Of the file; None where the cell has none. What it does not say of the bridges' sensitivity is computed
            from the drawing.

    Raises:
        InputError: A gauge sits on no surface of the holder.
    """
    if table is None:
        return None
    beam = HolderBeam(
        length_m=table.length_mm * MM,
        distance_m=table.cheek_distance_mm * MM,
        thickness_m=table.cheek_thickness_mm * MM,
        width_m=table.cheek_width_mm * MM,
        e_pa=table.youngs_modulus_gpa * _GPA,
        poisson_ratio=table.poisson_ratio,
    )
    gauges = tuple(Gauge((g.x_mm * MM, g.y_mm * MM, g.z_mm * MM), g.angle_deg * DEG, g.factor) for g in table.gauges)
    designed = StrainHolder.designed(beam, gauges, np.array(table.tcp_mm) * MM, table.noise_um_m * MICRO, table.segment)
    zero = designed.bias
    return replace(
        designed,
        sensitivity=np.array(table.sensitivity_um_m_per_kn) * (MICRO / KN)
        if table.sensitivity_um_m_per_kn
        else designed.sensitivity,
        bias=np.array(table.bias_um_m) * MICRO if table.bias_um_m else zero,
        per_kelvin=np.array(table.temperature_um_m_per_k) * MICRO if table.temperature_um_m_per_k else zero,
        reference_c=table.reference_c,
    )


def sensing_of(sensor: SensorTable | None, holder: HolderTable | None, chain: ElasticChain) -> dict[str, Any]:
    """Return the force measurements of a cell by the name of their table; nothing for tables that are not there.

    Raises:
        InputError: The end effector has no such body, or a gauge sits on no surface of the holder.
    """
    results = {"sensor": flange_sensor(sensor, chain), "holder": strain_holder(holder)}
    return {name: value for name, value in results.items() if value is not None}


SigmaUm = Annotated[float, Field(gt=0.0, le=1e6)]
SigmaUrad = Annotated[float, Field(gt=0.0, le=1e6)]


class TrackerTable(PoseTable):
    """Pose of the tracker in the robot base, and of its target on the tool (or on the flange)."""

    sigma_um: tuple[SigmaUm, SigmaUm, SigmaUm] | None = None
    sigma_urad: tuple[SigmaUrad, SigmaUrad, SigmaUrad] | None = None
    target_on: Literal["tcp", "flange"] = "tcp"
    target_x_mm: Length = 0.0
    target_y_mm: Length = 0.0
    target_z_mm: Length = 0.0
    target_a_deg: Angle = 0.0
    target_b_deg: Angle = 0.0
    target_c_deg: Angle = 0.0
    target_sigma_um: tuple[SigmaUm, SigmaUm, SigmaUm] | None = None
    target_sigma_urad: tuple[SigmaUrad, SigmaUrad, SigmaUrad] | None = None
    source: str = ""

    @property
    def T_base_tracker(self) -> Float:
        """(4, 4) m."""
        return self.matrix()

    @property
    def T_on_target(self) -> Float:
        """(4, 4) m, target in the frame that ``target_on`` names."""
        p = np.array([self.target_x_mm, self.target_y_mm, self.target_z_mm]) * MM
        return pose.from_xyz_zyx(p, np.array([self.target_a_deg, self.target_b_deg, self.target_c_deg]) * DEG)

    @property
    def sigma(self) -> Float | None:
        """(6,) m, rad of the tracker's pose in its own axes, or None."""
        return _six(self.sigma_um, self.sigma_urad)

    @property
    def target_sigma(self) -> Float | None:
        """(6,) m, rad of the target's pose in its own axes, or None."""
        return _six(self.target_sigma_um, self.target_sigma_urad)


def _six(um: tuple[float, float, float] | None, urad: tuple[float, float, float] | None) -> Float | None:
    if um is None or urad is None:
        return None
    return np.concatenate([np.array(um) * UM, np.array(urad) * URAD])
