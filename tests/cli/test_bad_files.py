"""Every option that takes a file, given files that are broken in every way: one line that names the file, status 2.

The options are those of the parser itself, so that a new one is covered.
"""

from __future__ import annotations

import inspect
import io
import shutil
import typing
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import pytest

from command_parser import command_of
from counterflex.app import examples
from counterflex.app.run.session import RunSettings, open_session
from counterflex.cli import arguments
from counterflex.cli.main import whole
from counterflex.core.errors import CounterflexError

EXAMPLES: Final = Path(__file__).parents[2] / "examples"
FILE_CHECKS: Final = (arguments.file, arguments.file_or_folder, arguments.robot_or_cell)

SOUND: Final = {
    "cell": "cell.toml", "program": "part.ngc", "truth": "truth.toml", "original": "part.ngc", "plan": "plan",
    "before": "part.ngc", "after": "part.ngc", "target": "cell.toml", "tap_test": "tap_test.csv", "rsi": "rsi.xml",
    "scan": "scan.csv", "holder": "across.toml", "files": "poses.csv", "touches": "touches.csv", "file": "rsi.xml",
    "data": "data.toml", "proposal": "proposal.toml", "certificate": "ball_bar.xml", "result": "result.json",
    "results": "result.json", "folder": "run", "folders": "run", "runs": "run", "response": "tap_test.csv",
    "log": "run",
}  # fmt: skip
"""What is given for a parameter, by its name, where another one is broken."""
WORDS: Final = {
    "to": "127.0.0.1:9", "peer": "127.0.0.1:9", "listen": "127.0.0.1:0", "value": "1", "recipe": "payload",
    "joints_deg": "0,-90,90,0,0,0", "language": "krl", "robot": "kuka_kr300_r2500_ultra", "name": "x", "seed": "1",
    "force_n": "0,1,0", "country": "DE", "keys": "sensor.range_n", "robot_name": "kuka_kr300_r2500_ultra",
}  # fmt: skip
BESIDE: Final[dict[tuple[str, str], dict[str, str]]] = {
    ("identify", ""): {"recipe": "payload", "data": "data.toml", "cell": "cell.toml", "out": "new/out"},
    ("identify", "holdout"): {"data": "data.toml", "cell": "cell.toml", "out": "new/out"},
    ("campaign", ""): {"cell": "cell.toml", "out": "new/out"},
    ("panel", "certificate"): {"key": "cell.toml"},
    ("panel", "key"): {"certificate": "cell.toml"},
    ("opcua", "certificate"): {"key": "cell.toml"},
    ("opcua", "key"): {"certificate": "cell.toml"},
    ("campaign", "program"): {"cell": "cell.toml", "seeds": "1"},
    ("egm check", "cell"): {"program": "dangerous.mod"},
    ("egm make", ""): {"cell": "online.toml"},
    ("rsi make", ""): {"cell": "online.toml"},
    ("twin egm", "program"): {"cell": "online.toml", "peer": "127.0.0.1:9"},
    ("benchmark-part judge", ""): {"method": "catalogue"},
    ("predict", "cell"): {"source": "data.toml"},
    ("reveal", "prediction"): {"measured": "data.toml"},
    ("reveal", "measured"): {"prediction": "cell.toml"},
    ("firstcut", ""): {"program": "part.ngc", "cell": "cell.toml", "out": "new/out"},
    ("quote", ""): {"part": "tolerances.csv", "program": "part.ngc", "cell": "cell.toml", "out": "new/out"},
    ("diff", ""): {"before": "part.ngc", "after": "part.ngc"},
    ("iso9283", ""): {"files": "log.csv", "poses": "poses.ngc"},
    ("iso9283", "path"): {"files": "log.csv"},
    ("iso230 circularity", ""): {"files": "log.csv", "path": "circle.ngc"},
    ("iso230 straightness", ""): {"files": "log.csv", "path": "square.ngc"},
    ("plan strategy", ""): {"program": "part.ngc", "cell": "cell.toml"},
    ("run", ""): {"rsi": "rsi.xml", "cell": "cell.toml"},
    ("twin cell", ""): {"rsi": "rsi.xml", "cell": "cell.toml", "truth": "truth.toml", "out": "new/out"},
    ("twin egm", "cell"): {"peer": "127.0.0.1:9"},
    ("cell import", ""): {"out": "new/cell.toml"},
    ("campaign", "placements"): {"cell": "cell.toml", "seeds": "1", "out": "new/out"},
    ("pose", ""): {"joints_deg": "0,-90,90,0,0,0"},
    ("campaign", "cell"): {"program": "part.ngc", "seeds": "1", "out": "new/out"},
    ("production", ""): {"runs": "run", "plan": "plan.parquet", "out": "new/out"},
    ("twin rsi", "program"): {"cell": "cell.toml"},
    ("twin rsi", "cell"): {"program": "part.ngc"},
    ("twin tracker", "cell"): {"run_log": "run"},
    ("dcc apply", ""): {"cell": "cell.toml", "keys": "sensor.range_n", "out": "new/out.toml"},
    ("dcc apply", "dataset"): {"keys": "sensor.range_n", "out": "new/out.toml"},
    ("inspect", ""): {"scan": "scan.ply"},
    ("inspect", "scan"): {},
    ("inspect", "tool_log"): {},
    ("inspect", "before"): {"scan": "scan.ply"},
}
"""Further options of a command, or of one that tries one of its files."""
ENDINGS: Final = {
    "program": (".ngc", ".src", ".mod", ".ls", ".pgx", ".mpf", ".apt", ".nc"),
    "original": (".ngc", ".src", ".mod"),
    "before": (".ngc", ".src", ".mod", ".ls", ".pgx"),
    "after": (".ngc",),
    "scan": (".stl", ".ply", ".csv", ".xyz", ".asc", ".obj", ".dmis", ".qif", ".npz"),
    "nominal": (".stl",),
    "tool_log": (".csv", ".parquet", ".mcap"),
    "plan": (".parquet",),
    "rsi": (".xml", ".rsi.xml"),
    "context": (".rsi.xml",),
    "krl": (".src",),
    "files": (".csv", ".dat", ".cfg", ".json", ".xml", ".txt", ".log"),
    "file": (".csv", ".xml", ".txt"),
    "data": (".toml", ".csv", ".parquet"),
    "holdout": (".toml",),
    "certificate": (".xml", ".pem"),
    "result": (".json",),
    "results": (".json",),
    "schema": (".xsd",),
    "users": (".toml",),
    "key": (".pem",),
    "dataset": (".toml",),
    "parameters": (".var",),
    "log": (".csv", ".txt"),
}


def _zip(content: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("content.xml", content)
    return stream.getvalue()


def _parquet() -> bytes:
    stream = io.BytesIO()
    pl.DataFrame({"a": [[1.0, 2.0]] * 3}).write_parquet(stream)
    return stream.getvalue()


def _npz() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, a=np.zeros(3))
    return stream.getvalue()


BROKEN: Final[dict[str, bytes]] = {
    "empty": b"",
    "blank": b"\n  \n\n",
    "zero bytes": b'format = "x"\n\0\0\0\0\n',
    "noise": bytes((7 * k * k + 13 * k) % 256 for k in range(4000)),
    "UTF-16": "\ufeffG1 X10 F100\n".encode("utf-16-le"),
    "half a character": b'name = "caf\xc3"\n',
    "huge line": b"1" * 2_000_000,
    "huge line of words": b"a = 1 " * 200_000,
    "huge number": b"a = " + b"1" * 6000 + b"\n",
    "huge number, JSON": b'{"format": ' + b"1" * 6000 + b"}",
    "deep, JSON": b'{"a":' * 100_000,
    "deep and closed, JSON": b'{"a":' * 100_000 + b"1" + b"}" * 100_000,
    "deep, TOML": b"a = " + b"[" * 100_000,
    "deep and closed, TOML": b"a = " + b"[" * 100_000 + b"]" * 100_000,
    "deep tables, TOML": b"[" + b"a." * 100_000 + b"a]",
    "deep, XML": b"<a>" * 100_000,
    "deep and closed, XML": b"<a>" * 100_000 + b"</a>" * 100_000,
    "XML with entities": b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c"><!ENTITY d "&b;&b;">]><a>&d;</a>',
    "XML of another kind": b"<html><body>404</body></html>",
    "zip": _zip(b"<a/>"),
    "zip cut off": _zip(b"<a/>" * 100)[:60],
    "gzip cut off": b"\x1f\x8b\x08\0\0\0\0\0\0\x03abc",
    "Parquet cut off": b"PAR1" + b"\x15\x04" * 40,
    "Parquet with a wrong footer": b"PAR1" + b"\x15\x04" * 40 + b"\xff\xff\xff\x7fPAR1",
    "MCAP cut off": b"\x89MCAP0\r\n" + b"\x01\xff\xff\xff\xff\0\0\0\0abc",
    "STL of more than it holds": b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 20,
    "STL without a facet": b"solid a\nendsolid a\n",
    "PLY without points": b"ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nend_header\n1\n",
    "Parquet of lists": _parquet(),
    "npz of another program": _npz(),
    "null": b"null",
    "list": b"[]",
    "number": b"1",
}


@dataclass(frozen=True)
class Option:
    """An option or argument of a command that takes a file.

    Attributes:
        command: Words that call the command.
        name: Of the parameter.
        words: Command line behind ``command``; ``@`` stands for the file.
    """

    command: tuple[str, ...]
    name: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{' '.join(self.command)}: {self.name}"

    def line(self, file: str) -> list[str]:
        """Return the command line with a file."""
        return [*self.command, *(file if word == "@" else word for word in self.words)]


def _commands(app: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Callable[..., Any]]]:
    for item in app.registered_commands:
        yield (*path, item.name or item.callback.__name__.replace("_", "-")), item.callback
    for group in app.registered_groups:
        yield from _commands(group.typer_instance, (*path, group.name))


def _flags(path: tuple[str, ...]) -> dict[str, list[str]]:
    """Words in front of the value of each parameter: none for an argument."""
    command, _ = command_of(list(path))
    return {param.name: [word for word in param.opts if word.startswith("--")][:1] for param in command.params}


def _options() -> list[Option]:
    found = []
    for path, function in _commands(whole()):
        infos = {
            name: typing.get_args(hint)[1]
            for name, hint in typing.get_type_hints(function, include_extras=True).items()
            if typing.get_origin(hint) is typing.Annotated
        }
        defaults, flags = inspect.signature(function).parameters, _flags(path)
        needed = [name for name in infos if defaults[name].default is inspect.Parameter.empty]
        for name, info in infos.items():
            if info.callback not in FILE_CHECKS:
                continue
            beside = BESIDE.get((" ".join(path), name), BESIDE.get((" ".join(path), ""), {}))
            words: list[str] = []
            for other in (one for one in infos if one in {*needed, *beside, name}):  # arguments in their order
                value = "@" if other == name else beside.get(other) or _value(other, infos[other])
                words += [*flags[other], value]
            found.append(Option(path, name, tuple(words)))
    return found


def _value(name: str, info: Any) -> str:
    if getattr(info.callback, "__name__", "").startswith("output"):
        return "new/out"
    return SOUND.get(name) or WORDS.get(name, "x")


OPTIONS: Final = _options()
RUN: Final = {option.name: option for option in OPTIONS if option.command == ("run",)}
"""``run`` reads in processes of its own: what these do first is tried with every fault, the command once."""
NOT_FIRST: Final = {
    ("correct", "scan"), ("benchmark-part judge", "scan"), ("production", "plan"), ("identify", "holdout"),
    ("twin measure", "cell"), ("twin measure", "truth"), ("twin tracker", "cell"), ("dcc write", "schema"),
    ("dcc apply", "cell"), ("cell import", "poses"), ("reveal", "measured"),
}  # fmt: skip
"""Read after another file of the command that no small example has: that one is named."""
EMPTY_IS_RIGHT: Final = {"parameters"}
"""A parameter file without lines is a machine whose parameters are all 0."""


@pytest.fixture(scope="module")
def given(machined: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a sound file for every option."""
    folder = tmp_path_factory.mktemp("given") / "work"
    shutil.copytree(machined.folder, folder)
    names = "tap_test.csv touches.csv tolerances.csv holders/across.toml controller/poses.csv egm/dangerous.mod"
    names += " certificates/ball_bar.xml"
    for name in (*names.split(), *(f"robot_tests/{kind}.ngc" for kind in ("poses", "circle", "square"))):
        shutil.copy(EXAMPLES / name, folder)
    shutil.copy(EXAMPLES / "scans" / "groove.ply", folder / "scan.ply")
    (folder / "rsi.xml").write_text(examples.text("rsi.xml"), encoding="utf-8")
    (folder / "log.csv").write_text("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,1,0,0\n", encoding="utf-8")
    cell = (folder / "cell.toml").read_text(encoding="utf-8")
    (folder / "online.toml").write_text(f'{cell}\n[online]\nforce = "pilot"\nperiod_ms = 24\n', encoding="utf-8")
    for name in ("plan.parquet", "data.toml", "proposal.toml", "result.json", "scan.csv"):
        (folder / name).write_text("", encoding="utf-8")
    (folder / "plan").mkdir()
    return folder


def _ends_well(given: Path, counterflex: Any, option: Option, kind: str, ending: str) -> None:
    name = f"broken{ending}"
    (given / name).write_bytes(BROKEN[kind])
    ended = counterflex(*option.line(name))
    (given / name).unlink()
    said = ended.err if option.command != ("run",) else ended.err.splitlines(keepends=True)[-1]  # before: "preparing"
    assert ended.status == 2, (option, kind, ended)
    assert said.startswith("error: "), (option, kind, ended)
    assert said.count("\n") == 1, (option, kind, ended)
    assert "Traceback" not in ended.err
    assert name in ended.err or (" ".join(option.command), option.name) in NOT_FIRST, (option, kind, ended.err)
    assert not (given / "new").exists()


def _kinds(option: Option) -> list[str]:
    return [kind for kind in BROKEN if option.name not in EMPTY_IS_RIGHT or kind not in ("empty", "blank")]


@pytest.mark.long
@pytest.mark.parametrize("place", range(len(OPTIONS)), ids=lambda place: str(OPTIONS[place]))
def test_every_option_of_the_parser(given: Path, counterflex: Any, monkeypatch: Any, place: int) -> None:
    monkeypatch.chdir(given)
    option = OPTIONS[place]
    kinds, endings = _kinds(option), ENDINGS.get(option.name, (".toml",))
    _ends_well(given, counterflex, option, kinds[7 * place % len(kinds)], endings[place % len(endings)])


@pytest.mark.long
@pytest.mark.parametrize("name", RUN)
def test_run_with_every_fault(given: Path, monkeypatch: Any, name: str) -> None:
    """By what the loop's process does before anything else."""
    monkeypatch.chdir(given)
    sound: dict[str, Any] = {"cell": Path("cell.toml"), "robot": ("rsi", Path("rsi.xml")), "plan": None}
    for kind, content in BROKEN.items():
        file = given / f"broken{ENDINGS.get(name, ('.toml',))[0]}"
        file.write_bytes(content)
        with pytest.raises(CounterflexError) as told:
            one: dict[str, Any] = {"robot": ("rsi", Path(file.name))} if name == "rsi" else {name: Path(file.name)}
            open_session(RunSettings(**{**sound, **one}))
        file.unlink()
        assert "\n" not in str(told.value), kind
        assert file.name in str(told.value), kind


READERS: Final = {
    "cell check": "cell", "path": "program", "dataset check": "data", "rsi check": "file", "dcc show": "certificate",
    "modes": "tap_test", "thermal": "model", "benchmark-part compare": "results", "inspect": "tolerances",
}  # fmt: skip


@pytest.mark.by_turn
@pytest.mark.parametrize("command", READERS)
def test_every_reader_with_every_fault(given: Path, counterflex: Any, monkeypatch: Any, command: str) -> None:
    monkeypatch.chdir(given)
    option = next(one for one in OPTIONS if (" ".join(one.command), one.name) == (command, READERS[command]))
    for number, kind in enumerate(kind for kind in _kinds(option) if not kind.startswith("huge line")):
        endings = ENDINGS.get(option.name, (".toml",))
        _ends_well(given, counterflex, option, kind, endings[number % len(endings)])


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("what", ["missing", "folder"])
def test_a_file_that_vanishes_after_the_check(
    given: Path, counterflex: Any, monkeypatch: Any, command: str, what: str
) -> None:
    monkeypatch.chdir(given)
    monkeypatch.setattr(arguments, "_paths", lambda _: [])
    option = next(one for one in OPTIONS if (" ".join(one.command), one.name) == (command, READERS[command]))
    name = f"{what}{ENDINGS.get(option.name, ('.toml',))[0]}"
    if what == "folder":
        (given / name).mkdir(exist_ok=True)
    ended = counterflex(*option.line(name))
    assert ended.status == 2, ended
    assert ended.err.count("\n") == 1
    assert name in ended.err
    assert ("no such file" if what == "missing" else "it is a folder") in ended.err
