"""The job ``log export --to``: a run of a log as a file of another viewer."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.log_export import foxglove
from counterflex.app.log_export.content import Content, content_of, plain
from counterflex.core.atomic import atomic_path
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.geometry import pose, rotation

_TIMELINE: Final = "time"
_GREY: Final = (150, 165, 178)


def require_rerun() -> None:
    """Check that the library is there. Raises InputError: it is not."""
    if importlib.util.find_spec("rerun") is None:
        raise InputError(
            "the export needs the package rerun-sdk", hint='Install it with pip install "counterflex[rerun]"'
        )


def write(content: Content, target: Path, range_m: float, progress: Progress = silent) -> int:
    """Write a run as ``.rrd``.

    Args:
        range_m: Deviation at which the colours of the cut end.

    Returns:
        Number of rows of curves, frames and texts.

    Raises:
        InputError: The library is not installed.
        OutputError: The file cannot be written.
    """
    require_rerun()
    import rerun

    with atomic_path(target) as part:
        stream: Any = rerun.RecordingStream("counterflex", recording_id=content.name, send_properties=False)
        stream.save(part)
        stream.log("base", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rows = _frames(rerun, stream, content)
        progress(0.4)
        _bodies(rerun, stream, content)
        _cut(rerun, stream, content, range_m)
        for one in content.happened:
            stream.set_time(_TIMELINE, timestamp=1e-9 * one.time_ns)
            stream.log("log", rerun.TextLog(one.text, level="WARN" if one.serious else "INFO"))
        rows += len(content.happened) + _curves(rerun, stream, content)
        stream.flush()
        stream.disconnect()
        del stream
    progress(1.0)
    return rows


def _entity(frame: str) -> str:
    """Path of a frame: the part and all frames of the robot stand in its base."""
    return {"base": "base", "commanded": "base/part/commanded", "corrected": "base/part/corrected"}.get(
        frame, f"base/{frame}"
    )


def _frames(rerun: Any, stream: Any, content: Content) -> int:
    """Poses of all frames, column by column."""
    times: list[int] = []
    moved: dict[str, list[np.ndarray[Any, Any]]] = {}
    for time_ns, poses in content.poses():
        times.append(time_ns)
        for frame, (_, T) in poses.items():
            moved.setdefault(frame, []).append(T)
    index = _time(rerun, np.array(times))
    for frame, rows in moved.items():
        Ts = np.array(rows)
        columns = rerun.Transform3D.columns(
            translation=Ts[:, :3, 3],
            quaternion=rotation.quat_wxyz(np.ascontiguousarray(Ts[:, :3, :3]))[:, [1, 2, 3, 0]],
        )
        stream.send_columns(_entity(frame), indexes=[index], columns=columns)
    return len(times) * len(moved)


def _time(rerun: Any, time_ns: Any) -> Any:
    return rerun.TimeColumn(_TIMELINE, timestamp=time_ns.astype("datetime64[ns]"))


def _bodies(rerun: Any, stream: Any, content: Content) -> None:
    for body in [] if content.scene is None else content.scene.bodies:
        T = pose.make(np.array(body["pose"][:9]).reshape(3, 3), np.array(body["pose"][9:]))
        path = f"{_entity(body['frame'])}/{body['name'].replace(' ', '_')}"
        quaternion = rerun.Quaternion(xyzw=rotation.quat_wxyz(T[:3, :3])[[1, 2, 3, 0]])
        stream.log(path, rerun.Transform3D(translation=T[:3, 3], quaternion=quaternion), static=True)
        size = body["size"]
        if body["shape"] == "box":
            stream.log(path, rerun.Boxes3D(half_sizes=[size[:3]], colors=[_GREY]), static=True)
        elif body["shape"] == "capsule":
            along = rerun.Capsules3D(
                lengths=[2.0 * size[1]], radii=[size[0]], translations=[[0.0, 0.0, -size[1]]], colors=[_GREY]
            )
            stream.log(path, along, static=True)
        else:
            stream.log(path, rerun.Cylinders3D(lengths=[2.0 * size[1]], radii=[size[0]], colors=[_GREY]), static=True)


def _cut(rerun: Any, stream: Any, content: Content, range_m: float) -> None:
    """Places of the cut with the colour of what remained, as they were cut."""
    if len(content.cut) == 0:
        return
    share = np.minimum(1.0, content.cut_rest_m / range_m)
    colours = np.stack([np.minimum(1.0, 2.0 * share), np.minimum(1.0, 2.0 - 2.0 * share), 0.1 + 0.0 * share], axis=1)
    seconds = (content.cut_ns - content.cut_ns[0]) // 1_000_000_000
    for k in np.unique(seconds):
        rows = seconds == k
        stream.set_time(_TIMELINE, timestamp=1e-9 * int(content.cut_ns[rows][-1]))
        points = rerun.Points3D(content.cut[rows], colors=(255.0 * colours[rows]).astype(np.uint8), radii=0.0005)
        stream.log(f"base/part/cut/{int(k):05d}", points)


def _curves(rerun: Any, stream: Any, content: Content) -> int:
    rows = 0
    for group, values in content.curves.items():
        for name, curve in values.items():
            known = np.isfinite(curve)
            index = _time(rerun, content.time_ns[known])
            stream.send_columns(f"{group}/{name}", indexes=[index], columns=rerun.Scalars.columns(scalars=curve[known]))
            rows += int(known.sum())
    return rows


VIEWERS: Final = {"foxglove": foxglove.write, "rerun": write}


def export_to(
    folder: Path, viewer: str, target: Path, *, number: int | None = None, range_m: float, progress: Progress = silent
) -> dict[str, Any]:
    """Write a run for another viewer.

    Args:
        viewer: One of :data:`VIEWERS`.
        number: Of the run; None is the last.
        range_m: Deviation at which the colours of the cut end.

    Returns:
        What was written, plain values, with ``messages``.

    Raises:
        InputError: No such viewer or run, or its library is not installed.
        OutputError: The file cannot be written.
    """
    if viewer not in VIEWERS:
        raise InputError("no such viewer", where="--to", value=viewer, limit=", ".join(VIEWERS))
    if viewer == "rerun":
        require_rerun()
    content = content_of(folder, number)
    progress(0.2)
    messages = VIEWERS[viewer](content, target, range_m, progress)
    return {"viewer": viewer, "messages": messages, **plain(content)}
