"""A run as MCAP with the well-known schemas of Foxglove, as JSON: frames, scene, log; curves with schemas of their own.

Source of names and fields: Foxglove SDK, schemas FrameTransform, SceneUpdate, Log (docs.foxglove.dev), JSON encoding.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType, Writer

from counterflex.app.log_export.content import Content
from counterflex.core.arrays import Float
from counterflex.core.atomic import atomic_path
from counterflex.core.progress import Progress, silent
from counterflex.geometry import rotation

_SECOND_NS: Final = 1_000_000_000
_NUMBER: Final[dict[str, Any]] = {"type": "number"}
_TIME: Final[dict[str, Any]] = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
}


def _object(title: str, **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


def _rows(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TEXT: Final[dict[str, Any]] = {"type": "string"}
_VECTOR: Final = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT: Final = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_COLOR: Final = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_POSE: Final = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_DURATION: Final = _object("duration", sec={"type": "integer"}, nsec={"type": "integer", "minimum": 0})
_PAIR: Final = _object("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)
_CUBE: Final = _object("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_BALL: Final = _object("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_ROUND: Final = _object(
    "foxglove.CylinderPrimitive", pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOR
)
_LINE: Final = _object(
    "foxglove.LinePrimitive",
    type={"title": "foxglove.LineType", "type": "integer"},
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant={"type": "boolean"},
    points=_rows(_POINT),
    color=_COLOR,
    colors=_rows(_COLOR),
    indices=_rows({"type": "integer", "minimum": 0}),
)
_ENTITY: Final = _object(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked={"type": "boolean"},
    metadata=_rows(_PAIR),
    arrows=_rows({"type": "object"}),
    cubes=_rows(_CUBE),
    spheres=_rows(_BALL),
    cylinders=_rows(_ROUND),
    lines=_rows(_LINE),
    triangles=_rows({"type": "object"}),
    texts=_rows({"type": "object"}),
    models=_rows({"type": "object"}),
)
SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    "foxglove.FrameTransform": _object(
        "foxglove.FrameTransform",
        timestamp=_TIME,
        parent_frame_id=_TEXT,
        child_frame_id=_TEXT,
        translation=_VECTOR,
        rotation=_QUATERNION,
    ),
    "foxglove.SceneUpdate": _object(
        "foxglove.SceneUpdate",
        deletions=_rows(_object("foxglove.SceneEntityDeletion", timestamp=_TIME, type={"type": "integer"}, id=_TEXT)),
        entities=_rows(_ENTITY),
    ),
    "foxglove.Log": _object(
        "foxglove.Log",
        timestamp=_TIME,
        level={"title": "foxglove.LogLevel", "type": "integer"},
        message=_TEXT,
        name=_TEXT,
        file=_TEXT,
        line={"type": "integer", "minimum": 0},
    ),
}
"""By name, as Foxglove knows them."""
_INFO, _WARNING = 2, 3
_STRIP: Final = 0
_GREY: Final = {"r": 0.6, "g": 0.65, "b": 0.7, "a": 0.5}
_SCENE_S: Final = 1.0  # How often the cut is drawn anew


class _Out:
    """Channels of the file, made when first used."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.messages = 0

    def put(self, topic: str, schema: str, layout: dict[str, Any], time_ns: int, message: dict[str, Any]) -> None:
        if topic not in self._channels:
            if schema not in self._schemas:
                data = json.dumps(layout).encode()
                self._schemas[schema] = self._writer.register_schema(name=schema, encoding="jsonschema", data=data)
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=self._schemas[schema]
            )
        data = json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
        self._writer.add_message(self._channels[topic], log_time=time_ns, data=data, publish_time=time_ns)
        self.messages += 1

    def known(self, topic: str, schema: str, time_ns: int, message: dict[str, Any]) -> None:
        self.put(topic, schema, SCHEMAS[schema], time_ns, message)


def write(content: Content, target: Path, range_m: float, progress: Progress = silent) -> int:
    """Write a run as MCAP that Foxglove reads without an extension.

    Args:
        range_m: Deviation at which the colours of the cut end.

    Raises:
        OutputError: The file cannot be written.
    """
    with atomic_path(target) as part, part.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="counterflex")
        writer.add_metadata("counterflex", {"run": content.name})
        out = _Out(writer)
        _frames(out, content)
        progress(0.4)
        _scene(out, content, range_m)
        for one in content.happened:
            level = _WARNING if one.serious else _INFO
            message = {"timestamp": _time(one.time_ns), "level": level, "message": one.text, "name": "counterflex"}
            out.known("/log", "foxglove.Log", one.time_ns, {**message, "file": "", "line": 0})
        progress(0.5)
        _curves(out, content)
        writer.finish()
    progress(1.0)
    return out.messages


def _time(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _SECOND_NS, "nsec": time_ns % _SECOND_NS}


def _xyz(p: Float) -> dict[str, float]:
    return {axis: float(v) for axis, v in zip("xyz", p, strict=True)}


def _turn(R: Float) -> dict[str, float]:
    w, x, y, z = (float(v) for v in rotation.quat_wxyz(R))
    return {"x": x, "y": y, "z": z, "w": w}


def _frames(out: _Out, content: Content) -> None:
    for time_ns, poses in content.poses():
        for child, (parent, T) in poses.items():
            message = {"timestamp": _time(time_ns), "parent_frame_id": parent, "child_frame_id": child}
            shift = {"translation": _xyz(T[:3, 3]), "rotation": _turn(T[:3, :3])}
            out.known("/tf", "foxglove.FrameTransform", time_ns, {**message, **shift})


def _entity(name: str, frame: str, time_ns: int) -> dict[str, Any]:
    empty: dict[str, list[Any]] = {
        kind: []
        for kind in ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    }
    forever = {"sec": 0, "nsec": 0}
    return {
        "timestamp": _time(time_ns), "frame_id": frame, "id": name, "lifetime": forever, "frame_locked": True, **empty
    }  # fmt: skip


def _scene(out: _Out, content: Content, range_m: float) -> None:
    """Bodies of the cell once, each in the frame that carries it; the cut as it grows."""
    begin = int(content.time_ns[0])
    bodies = [] if content.scene is None else content.scene.bodies
    entities = []
    for body in bodies:
        entity = _entity(body["name"], body["frame"], begin)
        R, p = np.array(body["pose"][:9]).reshape(3, 3), np.array(body["pose"][9:])
        place = {"position": _xyz(p), "orientation": _turn(R)}
        size = body["size"]
        if body["shape"] == "box":
            entity["cubes"] = [{"pose": place, "size": _xyz(2.0 * np.array(size[:3])), "color": _GREY}]
        else:  # a radius and half a length
            wide = {"x": 2.0 * size[0], "y": 2.0 * size[0], "z": max(2.0 * size[1], 1e-6)}
            entity["cylinders"] = [{"pose": place, "size": wide, "bottom_scale": 1.0, "top_scale": 1.0, "color": _GREY}]
            if body["shape"] == "capsule":
                ball = {"x": 2.0 * size[0], "y": 2.0 * size[0], "z": 2.0 * size[0]}
                entity["spheres"] = [
                    {
                        "pose": {"position": _xyz(p + end * size[1] * R[:, 2]), "orientation": place["orientation"]},
                        "size": ball,
                        "color": _GREY,
                    }
                    for end in (-1.0, 1.0)
                ]
        entities.append(entity)
    if entities:
        out.known("/cell", "foxglove.SceneUpdate", begin, {"deletions": [], "entities": entities})
    seconds = (content.cut_ns - begin) // round(_SCENE_S * _SECOND_NS)
    for k in np.flatnonzero(np.diff(seconds, append=seconds[-1:] + 1)):
        first = int(np.searchsorted(seconds, seconds[k]))
        rows = slice(max(0, first - 1), int(k) + 1)  # from the last point of the piece before
        time_ns = int(content.cut_ns[k])
        entity = _entity(f"cut {int(seconds[k])}", "part", time_ns)
        entity["lines"] = [
            {
                "type": _STRIP,
                "pose": {"position": _xyz(np.zeros(3)), "orientation": _turn(np.eye(3))},
                "thickness": 3.0,
                "scale_invariant": True,
                "points": [_xyz(p) for p in content.cut[rows]],
                "color": _GREY,
                "colors": [colour(float(v), range_m) for v in content.cut_rest_m[rows]],
                "indices": [],
            }
        ]
        out.known("/cut", "foxglove.SceneUpdate", time_ns, {"deletions": [], "entities": [entity]})


def colour(rest_m: float, range_m: float) -> dict[str, float]:
    """Green without deviation, over yellow to red where the colours end."""
    share = min(1.0, rest_m / range_m)
    return {"r": min(1.0, 2.0 * share), "g": min(1.0, 2.0 - 2.0 * share), "b": 0.1, "a": 1.0}


def _curves(out: _Out, content: Content) -> None:
    for group, values in content.curves.items():
        names, table = list(values), np.stack(list(values.values()), axis=1)
        layout = _object(f"counterflex.{group}", **dict.fromkeys(names, _NUMBER))
        known = np.isfinite(table)
        for k in np.flatnonzero(known.any(axis=1)):
            message = {
                name: round(float(v), 4) for name, v, good in zip(names, table[k], known[k], strict=True) if good
            }
            out.put(f"/{group}", f"counterflex.{group}", layout, int(content.time_ns[k]), message)
