"""Canonical channels of datasets: which numbers a name stands for, in which SI and file units; and known settings.

A recipe that needs a new channel or setting adds its line to its own block here; files, twin measurements and messages
then know it. Names follow the conventions: ``p_a_b`` position of b in a, ``R_a_b`` rotation, ``w``/``f`` wrench and
force, ``d`` displacement (loaded minus unloaded).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from counterflex.core.errors import InputError
from counterflex.core.similar import close_to

Nature = Literal["scalars", "joints", "point", "vector", "wrench", "twist", "rotation"]
"""How the numbers of a channel change with the frame they are given in, and what the file may state about them."""


@dataclass(frozen=True)
class ChannelKind:
    """Meaning of a channel name."""

    text: str  # in words, with frame and sign
    components: tuple[str, ...]  # names of its numbers, as they end the column names that counterflex writes
    si: str | tuple[str, ...]  # SI unit, of all numbers or of each
    file: str | tuple[str, ...]  # unit that counterflex writes, of all or of each
    nature: Nature = "scalars"  # see Nature
    counts: tuple[int, ...] = ()  # how many of the leading components a dataset may have; empty means all of them
    whole: bool = False  # whole numbers: an index or a count

    @property
    def allowed(self) -> tuple[int, ...]:
        """Numbers of components that a dataset may have."""
        return self.counts or (len(self.components),)

    def si_units(self, count: int) -> tuple[str, ...]:
        """SI unit of each of ``count`` components."""
        return (self.si,) * count if isinstance(self.si, str) else self.si[:count]

    def file_units(self, count: int) -> tuple[str, ...]:
        """Unit that counterflex writes for each of ``count`` components."""
        return (self.file,) * count if isinstance(self.file, str) else self.file[:count]


_XYZ = ("x", "y", "z")
_RXYZ = ("rx", "ry", "rz")
_AXES = ("1", "2", "3", "4", "5", "6")
_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_WRENCH_SI = ("N", "N", "N", "N m", "N m", "N m")
_TWIST_SI = ("m", "m", "m", "rad", "rad", "rad")
_TWIST_FILE = ("mm", "mm", "mm", "deg", "deg", "deg")


def _point(text: str) -> ChannelKind:
    return ChannelKind(text, _XYZ, "m", "mm", "point")


def _rotation(text: str) -> ChannelKind:
    return ChannelKind(text, _RXYZ, "rad", "deg", "rotation")


_ARM: Final = {
    "q": ChannelKind("joint angles that the controller shows", _AXES, "rad", "deg", "joints"),
    "q_command": ChannelKind("commanded joint angles", _AXES, "rad", "deg", "joints", counts=(1, 2, 3, 4, 5, 6)),
    "q_motor": ChannelKind(
        "joint angles by the motor encoders, on the link side of the gear",
        _AXES,
        "rad",
        "deg",
        "joints",
        counts=(1, 2, 3, 4, 5, 6),
    ),
    "q_link": ChannelKind(
        "joint angles by the encoders on the links", _AXES, "rad", "deg", "joints", counts=(1, 2, 3, 4, 5, 6)
    ),
    "tau_motor": ChannelKind(
        "motor torques on the link side of the gear", _AXES, "N m", "N m", counts=(1, 2, 3, 4, 5, 6)
    ),
    "p_base_tcp": _point("tool tip in the robot base"),
    "R_base_tcp": _rotation("orientation of the tool frame in the robot base"),
    "p_base_flange": _point("flange in the robot base"),
    "R_base_command": _rotation("commanded orientation of the tool frame in the robot base"),
    "R_base_flange": _rotation("orientation of the flange in the robot base"),
}
_TRACKER: Final = {
    "p_tracker_target": _point("reflector or six-axis target in the tracker"),
    "R_tracker_target": _rotation("orientation of the six-axis target in the tracker"),
    "p_base_fiducial": _point("known place of a fiducial in the robot base"),
    "p_tracker_fiducial": _point("fiducial as the tracker measures it"),
    "target": ChannelKind("number of the reflector that was measured", ("",), "1", "1", whole=True),
    "q_second": ChannelKind("joint angles of the other pose of a distance", _AXES, "rad", "deg", "joints"),
    "distance": ChannelKind(
        "from the tool's reference point to the anchor, or to where it is in the other pose", ("",), "m", "mm"
    ),
    "anchor": ChannelKind("number of the fixed end of a ball bar", ("",), "1", "1", whole=True),
    "pose": ChannelKind("number of the commanded pose, from 1", ("",), "1", "1", whole=True),
    "direction": ChannelKind("number of the direction from which a pose was approached", ("",), "1", "1", whole=True),
    "plane": ChannelKind("number of the plane that was touched", ("",), "1", "1", whole=True),
}
_LOADS: Final = {
    "w_tcp_base": ChannelKind(
        "force and moment on the tool about the tool tip, base axes", _WRENCH, _WRENCH_SI, _WRENCH_SI, "wrench"
    ),
    "f_tcp_base": ChannelKind("force on the tool at the tool tip, base axes", ("fx", "fy", "fz"), "N", "N", "vector"),
    "d_tcp_base": ChannelKind(
        "displacement of the tool tip, loaded minus unloaded, base axes (and rotation vector)",
        (*_XYZ, *_RXYZ),
        _TWIST_SI,
        _TWIST_FILE,
        "twist",
        counts=(3, 6),
    ),
    "w_sensor": ChannelKind(
        "force and moment that the sensor shows, what acts on its tool side, sensor axes and origin",
        _WRENCH,
        _WRENCH_SI,
        _WRENCH_SI,
        "wrench",
    ),
}
_PULLS: Final = {
    "d_tracker_target": ChannelKind(
        "displacement of the target, loaded minus unloaded, tracker axes (and rotation vector)",
        (*_XYZ, *_RXYZ),
        _TWIST_SI,
        _TWIST_FILE,
        "twist",
        counts=(3, 6),
    ),
    "approach": ChannelKind("joint angles from where a pose was reached, minus those of the pose", _AXES, "rad", "deg"),
    "pair": ChannelKind("which pair of measuring cubes, counted from 1 in settings.pairs", ("",), "1", "1", whole=True),
    "p_base_before": _point("centre of the cube before the elastic elements, unloaded"),
    "p_base_after": _point("centre of the cube after the elastic elements, unloaded"),
    "d_before_base": ChannelKind(
        "motion of the cube before the elastic elements, loaded minus unloaded: centre, rotation vector, base axes",
        (*_XYZ, *_RXYZ),
        _TWIST_SI,
        _TWIST_FILE,
        "twist",
    ),
    "d_after_base": ChannelKind(
        "motion of the cube after the elastic elements, loaded minus unloaded: centre, rotation vector, base axes",
        (*_XYZ, *_RXYZ),
        _TWIST_SI,
        _TWIST_FILE,
        "twist",
    ),
}
_FRAME: Final = {
    "s_unloaded": ChannelKind(
        "distances that the sensors of a measuring frame show without load, in the order of [[sensors]]",
        tuple(str(i) for i in range(1, 25)),
        "m",
        "mm",
        counts=tuple(range(3, 25)),
    ),
    "s_loaded": ChannelKind(
        "distances that the sensors of a measuring frame show with load, in the order of [[sensors]]",
        tuple(str(i) for i in range(1, 25)),
        "m",
        "mm",
        counts=tuple(range(3, 25)),
    ),
    "p_base_frame": _point("origin of the measuring frame's axes in the robot base"),
    "R_base_frame": _rotation("orientation of the measuring frame's axes in the robot base"),
}
_CLOCK: Final = {
    "time_s": ChannelKind("time", ("",), "s", "s"),
    "temperature_c": ChannelKind("temperature", ("",), "degC", "degC"),
}

_RECORDS: Final = {
    "time_tracker_s": ChannelKind("time stamps of the tracker's channels by the clock that gave them", ("",), "s", "s"),
    "time_force_s": ChannelKind(
        "time stamps of the force sensor's channel by the clock that gave them", ("",), "s", "s"
    ),
    "time_link_s": ChannelKind("time stamps of the encoders on the links by the clock that gave them", ("",), "s", "s"),
    "p_base_command": _point("commanded tool tip in the robot base"),
    "d_correction": ChannelKind(
        "correction given to the sensor interface, translation in base axes", _XYZ, "m", "mm", "vector"
    ),
}

_SLOTS: Final = {
    "f_tcp_part": ChannelKind("force on the tool at the tool tip, part axes", ("fx", "fy", "fz"), "N", "N"),
    "feed_direction": ChannelKind("unit vector along the feed, part axes", _XYZ, "1", "1"),
    "feed_rate": ChannelKind("programmed feed", ("",), "m/s", "mm/min"),
    "spindle_speed": ChannelKind("spindle speed, positive clockwise seen from the spindle (M3)", ("",), "rad/s", "rpm"),
    "depth": ChannelKind("commanded axial depth of cut under the stated top of the blank, 0 in air", ("",), "m", "mm"),
    "width": ChannelKind(
        "commanded width of cut: positive from the left edge of the cutter (up-milling with M3), negative from the "
        "right (down-milling), the diameter or more a slot",
        ("",),
        "m",
        "mm",
    ),
    "depth_measured": ChannelKind("depth of cut measured on the finished part", ("",), "m", "mm"),
    "tool": ChannelKind("number of the tool", ("",), "1", "1", whole=True),
    "blank": ChannelKind("number of the blank that was cut", ("",), "1", "1", whole=True),
}

_SENSING: Final = {
    "accelerometer_sensor": ChannelKind(
        "what an accelerometer at the sensor shows: acceleration minus gravity, sensor axes", _XYZ, "m/s2", "m/s2"
    ),
    "strain": ChannelKind(
        "strain that each bridge of the spindle holder shows, lengthening positive",
        tuple(str(i) for i in range(1, 13)),
        "1",
        "um/m",
        counts=tuple(range(3, 13)),
    ),
    "f_tcp_holder": ChannelKind(
        "force on the tool, by a dynamometer, in axes of the spindle holder", ("fx", "fy", "fz"), "N", "N", "vector"
    ),
    "p_holder_load": _point("where that force acts, in the frame of the spindle holder"),
}

CHANNELS: Final[dict[str, ChannelKind]] = {
    **_ARM,
    **_TRACKER,
    **_LOADS,
    **_PULLS,
    **_FRAME,
    **_CLOCK,
    **_RECORDS,
    **_SLOTS,
    **_SENSING,
}
"""By canonical name."""

KINDS: Final[dict[str, str]] = {
    "tracker_poses": "poses of a six-axis tracker target",
    "tracker_points": "points of one or several tracker reflectors",
    "distances": "distances, for example of a ball bar",
    "planes": "points where a touch probe met planes",
    "pulls": "displacement of the tool under known loads",
    "cubes": "relative motion of measuring cubes on the structure",
    "reversals": "slow reversals of single axes",
    "record": "channels recorded over time",
    "sensor_poses": "readings of the force sensor in many orientations",
    "sensor_motion": "readings of the force sensor while the arm moves without a process",
    "holder_loads": "bridges of the instrumented tool holder under known loads",
    "slots": "forces of test cuts",
    "fiducials": "fiducial points known in the base and measured by the tracker",
    "pose_test": "commanded poses attained again and again, for ISO 9283",
    "path_test": "log of a tracker along a commanded path, for ISO 9283 and ISO 230",
    "servo_steps": "answers of axes or corrections to steps",
}
"""Kinds of datasets, in words."""

MEASURED_IN: Final[dict[str, tuple[str, ...]]] = {
    "tracker_poses": ("p_tracker_target", "R_tracker_target"),
    "tracker_points": ("p_tracker_target",),
    "distances": ("distance",),
    "planes": ("q",),
    "pulls": ("d_tcp_base", "d_tracker_target", "s_loaded"),
    "cubes": ("d_before_base", "d_after_base"),
    "sensor_poses": ("w_sensor",),
    "sensor_motion": ("w_sensor",),
    "holder_loads": ("strain",),
    "slots": ("f_tcp_part", "f_tcp_base", "w_sensor"),
    "fiducials": ("p_tracker_fiducial",),
}
"""Channels that hold what was measured, the others saying at what; of kinds that are not here every channel counts."""

CHANNELS_OF: Final[dict[str, tuple[str, ...]]] = {
    "tracker_poses": ("q", "p_tracker_target", "R_tracker_target"),
    "tracker_points": ("q", "p_tracker_target"),
    "distances": ("q", "distance"),
    "planes": ("q", "plane"),
    "pulls": ("q", "f_tcp_base", "d_tcp_base"),
    "cubes": ("q", "w_tcp_base", "pair", "p_base_before", "p_base_after", "d_before_base", "d_after_base"),
    "reversals": ("time_s", "q_motor", "tau_motor", "p_tracker_target"),
    "record": ("time_s", "q_motor", "p_base_command", "p_base_tcp", "p_tracker_target"),
    "servo_steps": ("time_s", "q_command", "q_motor", "tau_motor", "f_tcp_base"),
    "sensor_poses": ("q", "w_sensor", "temperature_c"),
    "sensor_motion": ("time_s", "q", "w_sensor"),
    "holder_loads": ("f_tcp_holder", "p_holder_load", "strain"),
    "slots": (
        "time_s", "q", "f_tcp_base", "feed_direction", "feed_rate", "spindle_speed", "depth", "width", "tool", "blank",
    ),
    "fiducials": ("p_base_fiducial", "p_tracker_fiducial"),
}  # fmt: skip
"""Channels of the form that a proposal for such data comes with."""

SAMPLED: Final = frozenset({"cubes", "reversals", "record", "servo_steps", "sensor_motion", "slots"})
"""Kinds of datasets with many rows for one proposed measurement: the form has no rows, an instrument writes them."""

SETTINGS: Final[dict[str, str]] = {
    "payload_kg": "additional mass on the flange, not in the cell file",
    "remark": "anything worth keeping",
    "air": "'none': no row of this record of cuts is in air",
    "bandwidth_hz": "frequency up to which the force sensor is true; single teeth are looked for only below it",
    "force_accuracy_n": "uncertainty (95 %) of each axis of the force sensor by its data sheet: % of range times range",
    "force_scale_sigma": "standard deviation of the scale of each axis of the force sensor, share of the force",
    "force_cross_talk_sigma": "standard deviation of what an axis shows of the force along another, share of it",
    "force_alignment_rad": "standard deviation of the turn of the force sensor against its stated axes, about each",
    "gauges": "where the bridges of the holder sit: x, y, z in m, angle in rad and factor of each, one after the other",
    "tracker": "name of the tracker's place, where other data were measured from elsewhere",
    "target": "name of the target or reflector, where other data were measured with another",
    "probe_sigma_m": "standard deviation with which the probe touches a plane",
    "p_tcp_load_m": "where the cable pulls, in the frame of the tool tip",
    "p_tcp_measured_m": "the point whose displacement was measured, in the frame of the tool tip",
    "sensor_axes": "axes of [[sensors]]: 'tcp' (of the unloaded tool, from its tip), 'base', or 'frame' (its place in "
    "p_base_frame, R_base_frame)",
    "sensor_alignment_rad": "standard deviation of the angle between faces and beams of a measuring frame",
    "history": "what the axes did before a loaded reading: 'approached again', 'held' or 'relaxed'",
    "approach": "'row order' if the rows are in the order of measurement",
    "readings": "readings of an instrument that were averaged",
    "pairs": "names of the bodies that the cubes of each pair sit on, 'base/axis1', in the order of channel 'pair'",
    "clock": "name of the clock that stamped time_s",
    "clock_tracker": "name of the clock that stamped time_tracker_s",
    "clock_force": "name of the clock that stamped time_force_s",
    "clock_link": "name of the clock that stamped time_link_s",
    "cycle_s": "true time between rows, where the stamps of the file are damaged",
    "rotor_inertia_kg_m2": "inertia of the motors seen on the link side, one number per axis of tau_motor",
    "gear_ratio": "turns of the motor per turn of the axis, where tau_motor was recorded on the side of the motor",
    "driven_axes": "numbers of the axes that the components of the joint channels belong to",
}
"""Further facts that a manifest may state under ``[settings]``, by SI name (files say ``_mm`` for ``_m``, ``_deg`` for
``_rad``)."""


def channel_kind(name: str, where: str = "") -> ChannelKind:
    """Meaning of a channel name. Raises InputError: it is no canonical name."""
    if name not in CHANNELS:
        close = close_to(name, sorted(CHANNELS), 1)
        raise InputError(
            "there is no such channel",
            where=where or None,
            value=name,
            hint=f"Did you mean '{close[0]}'?" if close else f"Channels: {', '.join(CHANNELS)}",
        )
    return CHANNELS[name]
