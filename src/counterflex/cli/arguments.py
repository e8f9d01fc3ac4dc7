"""Options and arguments, checked before any job is loaded: files, folders, addresses, lists of numbers.

Each check is the ``callback`` of an option or an argument: it takes the option and its value and hands the value on.
Nothing here may import a job: a wrong name is to be told at once.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import typer

from counterflex.core.errors import InputError, OutputError
from counterflex.core.moving import settle
from counterflex.core.output_place import place_of
from counterflex.core.similar import close_to, missing_file

MOST_SEEDS: Final = 100
_SEEDS: Final = re.compile(r"\d{1,18}(-\d{1,18})?(,\d{1,18}(-\d{1,18})?)*", re.ASCII)
LARGEST_SEED: Final = 2**31 - 1
MOST_WORKERS: Final = 256
MOST_PROPOSED: Final = 500
"""Measurements that a laboratory could still make."""
MOST_RECORDS: Final = 100_000_000
"""Cycles, samples, datagrams: four days at 4 ms."""
Param = typer.CallbackParam
Check = Callable[..., Any]
"""Takes the option and its value, and hands the value on or raises."""


def option(name: str, text: str, check: Check | None = None, metavar: str | None = None, **more: Any) -> Any:
    """An option of a command: its names with blanks between, its help, what checks a value, what stands for one."""
    return typer.Option(*name.split(), help=text, callback=check, metavar=metavar, **more)


def argument(text: str, check: Check | None = None, metavar: str | None = None, **more: Any) -> Any:
    """An argument of a command: its help, what checks a value, what stands for one."""
    return typer.Argument(help=text, callback=check, metavar=metavar, **more)


def _paths(value: Any) -> list[Path]:
    if value is None:
        return []
    return [Path(item) for item in value] if isinstance(value, (list, tuple)) else [Path(value)]


def _read(value: Any) -> list[Path]:
    """Return paths that are read; what a killed command had begun to write there is completed first."""
    paths = _paths(value)
    for path in paths:
        settle(path)
    return paths


def _named(param: Param, path: Path) -> str:
    """Place of a fault: by which option the file was given, and the file."""
    options = [name for name in param.opts if name.startswith("--")]
    return f"{options[0]} {path}" if options else str(path)


def _readable(param: Param, path: Path) -> None:
    if not os.access(path, os.R_OK):
        raise InputError("it may not be read: permission denied", where=_named(param, path))


def file(param: Param, value: Any) -> Any:
    """A file that is read. Raises InputError: there is none, or it is a folder, or may not be read."""
    for path in _read(value):
        if path.is_dir():
            raise InputError("it is a folder", where=_named(param, path), limit="a file")
        if not path.exists():
            raise InputError("no such file", where=_named(param, path), hint=missing_file(path))
        _readable(param, path)
    return value


def folder(param: Param, value: Any) -> Any:
    """A folder that is read. Raises InputError: there is none, or it is a file."""
    for path in _read(value):
        if not path.exists():
            raise InputError("no such folder", where=_named(param, path), hint=missing_file(path))
        if not path.is_dir():
            raise InputError("it is no folder", where=_named(param, path), limit="a folder")
        _readable(param, path)
    return value


def file_or_folder(param: Param, value: Any) -> Any:
    """A file or folder that is read. Raises InputError: there is none."""
    for path in _read(value):
        if not path.exists():
            raise InputError("no such file or folder", where=_named(param, path), hint=missing_file(path))
        _readable(param, path)
    return value


def output_file(param: Param, value: Any) -> Any:
    """A file that is written; folders above it are made.

    Raises:
        OutputError: It cannot be: a folder has its name, a file stands in the way, no permission.
    """
    for path in _paths(value):
        try:
            place_of(path)
        except OSError as fault:
            raise OutputError(f"cannot write: {fault.strerror}", where=_named(param, path)) from fault
        _way_to(param, path)
    return value


def output_folder(param: Param, value: Any) -> Any:
    """A folder that results are written to; made when missing.

    Raises:
        OutputError: It cannot be: a file has its name or stands in the way, no permission.
    """
    for path in _paths(value):
        if path.exists() and not path.is_dir():
            raise OutputError("cannot write: a file has the name of the folder", where=_named(param, path))
        if path.is_symlink() and not path.exists():
            target = str(path.readlink())
            raise OutputError("cannot write: a link that leads nowhere", where=_named(param, path), value=target)
        _way_to(param, path)
        if path.is_dir():
            _writable(param, path, path)
    return value


def _way_to(param: Param, path: Path) -> None:
    """Refuse a path below something that is no folder, or where nothing may be written."""
    for above in path.absolute().parents:
        if above.exists():
            if not above.is_dir():
                raise OutputError(f"cannot write: {above.name} is no folder", where=_named(param, path))
            if not path.exists():
                _writable(param, path, above)
            return


def _writable(param: Param, path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(
            f"cannot write: nothing may be written in {folder}",
            where=_named(param, path),
            hint=f"Choose another {param.opts[0]}",
        )


def host_port(param: Param, value: Any) -> Any:
    """An address ``HOST:PORT``."""
    if value is not None:
        address(value, param.opts[0] if param.opts[0].startswith("--") else "HOST:PORT")
    return value


def seeds(text: str) -> list[int]:
    """Truth seeds of ``--seeds``: ``5`` is 1 to 5; ``2001-2008,2011`` are ranges and single seeds.

    Raises:
        InputError: None of these, a seed twice, none, or more than :data:`MOST_SEEDS`, or beyond :data:`LARGEST_SEED`.
    """
    if not _SEEDS.fullmatch(text):
        raise InputError(
            "no seeds", where="--seeds", value=text[:80], limit="a number of seeds such as 5, or 2001-2008,2011"
        )
    ends = [(int(word.split("-")[0]), int(word.split("-")[-1])) for word in text.split(",")]
    if text.isdigit():
        ends = [(1, int(text))]
    if not 0 < sum(last + 1 - first for first, last in ends) <= MOST_SEEDS or any(last < first for first, last in ends):
        hint = f"One seed alone: {text}-{text}" if text.isdigit() else None
        raise InputError(
            "number of seeds is out of range", where="--seeds", value=text, limit=f"1 to {MOST_SEEDS}", hint=hint
        )
    numbers = [seed for first, last in ends for seed in range(first, last + 1)]
    if max(numbers) > LARGEST_SEED:
        raise InputError("seed is out of range", where="--seeds", value=max(numbers), limit=f"at most {LARGEST_SEED}")
    if twice := [seed for i, seed in enumerate(numbers) if seed in numbers[:i]]:
        raise InputError("a seed is given twice", where="--seeds", value=twice[0], limit="each seed once")
    return numbers


def address(text: str, option: str) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isascii() or not port.isdigit() or not 0 <= int(port) <= 65535:
        raise InputError(f"{option} is no address", value=text, limit="HOST:PORT, for example 192.168.1.1:49152")
    return host, int(port)


def angles_of_body(param: Param, value: Any) -> Any:
    """Angles of a body, ``spindle.b_deg=0,-35``. Raises InputError: the text says something else."""
    if value is not None:
        body_angles(value, param.opts[0])
    return value


_ANGLES: Final = re.compile(r"(?P<body>.+)\.(?P<key>[abc]_deg)=(?P<values>[^=]+)")


def body_angles(text: str, name: str) -> tuple[str, str, tuple[float, ...]]:
    """Read ``spindle.b_deg=0,-35``: body, key and angles in deg.

    Raises:
        InputError: It says something else, or an angle is beyond 360 deg.
    """
    match = _ANGLES.fullmatch(text.strip())
    try:
        values = () if match is None else tuple(float(word) for word in match["values"].split(","))
    except ValueError:
        values = ()
    if match is None or not values or not all(-360.0 <= value <= 360.0 for value in values):
        raise InputError(
            "no angles of a body",
            where=name,
            value=repr(text),
            limit="BODY.KEY=A,B with KEY a_deg, b_deg or c_deg, -360 to 360 deg",
            hint="BODY is one of [[end_effector]], or tcp: spindle.b_deg=0,-35",
        )
    return match["body"], match["key"], values


def region(words: list[str], name: str) -> tuple[tuple[float, ...] | None, dict[str, tuple[float, float]]]:
    """Read a region: six numbers, and ranges of external axes as ``E1=0,2000``.

    Returns:
        The six numbers or None, and the ranges by name.

    Raises:
        InputError: A word says something else, or something is given twice.
    """
    box: tuple[float, ...] | None = None
    axes: dict[str, tuple[float, float]] = {}
    for word in words:
        axis, equals, values = word.rpartition("=")
        if (axis in axes) if equals else box is not None:
            raise InputError(f"{name} is given twice", value=axis or word)
        ends = numbers(values, name, 2 if equals else 6) or []
        if equals:
            axes[axis.strip()] = (ends[0], ends[1])
        else:
            box = tuple(ends)
    return box, axes


def numbers_of(count: int) -> Callable[[Param, Any], Any]:
    """Check of a list of that many numbers."""

    def check(param: Param, value: Any) -> Any:
        numbers(value, param.opts[0], count)
        return value

    return check


def numbers(text: str | None, name: str, count: int) -> list[float] | None:
    """Read ``1,2,3`` as that many numbers. Raises InputError: they are not, or not as many, or not finite."""
    if text is None:
        return None
    try:
        values = [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError as fault:
        raise InputError(
            f"{name} is not a list of numbers", value=repr(text), limit=f"{count} numbers, separated by commas"
        ) from fault
    if not all(math.isfinite(value) for value in values):
        raise InputError(f"{name} holds a number that is not finite", value=repr(text), limit="finite numbers")
    if len(values) != count:
        raise InputError(
            f"{name} has {len(values)} numbers", value=repr(text), limit=f"{count} numbers, separated by commas"
        )
    return values


def span(text: str | None, name: str) -> tuple[float, float] | None:
    """Read ``3`` or ``0.5:3`` as the least and the largest value of a range.

    Raises:
        InputError: It is none, or not above 0, or empty.
    """
    if text is None:
        return None
    try:
        values = [float(part) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 2) or not all(math.isfinite(value) and value > 0.0 for value in values):
        raise InputError(f"{name} is no range", value=repr(text), limit="a number above 0, or LOW:HIGH")
    if values[0] > values[-1]:
        raise InputError(f"{name} is an empty range", value=repr(text), limit="LOW:HIGH with LOW <= HIGH")
    return values[0], values[-1]


def positive_range(param: Param, value: Any) -> Any:
    """A range of values above 0, see :func:`span`."""
    span(value, param.opts[0])
    return value


def one_of(
    names: Iterable[object] | Callable[[], Iterable[object]], what: str = "value", *more: str
) -> Callable[[Param, Any], Any]:
    """Check of a name, or of several, out of a list.

    Args:
        names: Allowed ones, or a function that returns them.
    """

    def check(param: Param, value: Any) -> Any:
        allowed = [
            *map(str, names() if callable(names) else names),
            *more,
        ]  # what other packages bring is looked up when it is needed
        for item in [] if value is None else value if isinstance(value, (list, tuple)) else [value]:
            if str(item) not in allowed:
                close = close_to(str(item), allowed, 1)
                raise InputError(
                    f"unknown {what}",
                    where=param.opts[0] if param.opts[0].startswith("--") else None,
                    value=item,
                    limit=", ".join(allowed),
                    hint=f"Did you mean {close[0]!r}?" if close else None,
                )
        return value

    return check


def between(low: float, high: float) -> Callable[[Param, Any], Any]:
    """Check of a number that has both a least and a largest value."""

    def check(param: Param, value: Any) -> Any:
        if value is not None and not low <= value <= high:
            raise InputError("out of range", where=param.opts[0], value=f"{value:g}", limit=f"{low:g} to {high:g}")
        return value

    return check


def robot_or_cell(param: Param, value: Any) -> Any:
    """A robot of the catalogue, or a cell file. Raises InputError: neither."""
    if value is None:
        return value
    settle(value)
    if Path(value).is_file():
        return value
    if value.endswith(".toml") or os.sep in value:
        return file(param, value)
    from counterflex.robot.model import catalog

    catalog.entry(value)
    return value


def frame_name(param: Param, value: Any) -> Any:
    """Name of a tool or base of a controller; empty for none.

    Raises:
        InputError: It holds other characters than such names.
    """
    if value and not re.fullmatch(r"[\w .$()+-]{1,64}", value):
        raise InputError("no name of a frame on a controller", where=param.opts[0], value=value[:40],
                         limit="letters, digits, blanks, _ . $ ( ) + -, at most 64")  # fmt: skip
    return value


def robot(_: Param, value: Any) -> Any:
    """A robot of the catalogue. Raises InputError: there is none of this name."""
    if value is not None:
        from counterflex.robot.model import catalog

        catalog.entry(value)
    return value


def scheduler(_: Param, value: Any) -> Any:
    """Address of a scheduler of dask."""
    if value is not None:
        from counterflex.app.long_jobs.scheduler import require_scheduler_address

        require_scheduler_address(value)
    return value


def postures(param: Param, value: Any) -> Any:
    """Postures by name: of the cell file, chosen, or configuration and rotation.

    Raises:
        InputError: One is none of these.
    """
    for text in value or []:
        if not re.fullmatch(r"present|chosen|(front|back) (up|down) (no)?flip [-+]?\d+(\.\d*)?", text.strip()):
            raise InputError(
                "that is no posture",
                where=param.opts[0],
                value=text,
                limit='present, chosen, or such as "front up noflip 180" (degrees, -360 to 360)',
            )
    return value


def material(_: Param, value: Any) -> Any:
    """Name of a row of the material tables. Raises InputError: there is no such row."""
    if value is not None:
        from counterflex.cutting import material as table

        table.load(value)
    return value


def faults(_: Param, value: Any) -> Any:
    """Faults in short form. Raises CounterflexError: one of them is none."""
    if value:
        from counterflex.files.fault_file import short_fault

        for text in value:
            short_fault(text).fault()
    return value


def settings(_: Param, value: Any) -> Any:
    """Settings ``KEY=VALUE``."""
    pairs(value or [])
    return value


def pairs(texts: list[str]) -> dict[str, str]:
    """Settings ``KEY=VALUE`` by key. Raises InputError: no ``=``, or a key given twice."""
    out: dict[str, str] = {}
    for text in texts:
        key, mark, value = text.partition("=")
        if not mark or not key:
            raise InputError("a setting is not KEY=VALUE", where=f"--set {text}")
        if key in out:
            raise InputError("a setting is given twice", where=f"--set {text}")
        out[key] = value
    return out
