"""What is wrong on the command line is said before anything heavy is loaded: every command, every path and option."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

HEAVY = ("numba", "scipy", "polars", "mujoco", "plotly")
WALK = textwrap.dedent(
    """
    import contextlib, io, json, sys, typing
    from pathlib import Path
    from counterflex.cli import main, start

    FREE = {"remove", "containing", "session", "host", "listen", "name", "sentype", "only", "pattern", "stall"}
    FREE |= {"laboratory", "robot_name", "material_name", "person", "city", "serial"}

    def commands(app, path=()):
        for item in app.registered_commands:
            yield (*path, item.name or item.callback.__name__.replace("_", "-")), item.callback
        for group in app.registered_groups:
            yield from commands(group.typer_instance, (*path, group.name))

    def bad_values(name, base, info):
        kinds = typing.get_args(base) or (base,)
        kinds = [k for kind in kinds for k in (typing.get_args(kind) or (kind,))]
        if Path in kinds:
            return ["nowhere-%s.toml" % name] if not writes(info) else ["file.txt/below/" + name]
        if bool in kinds:
            return []
        if int in kinds or float in kinds:
            values = ["abc"] + (["nan", "inf"] if float in kinds else ["1.5"])
            if info.min is not None:
                values.append(str(info.min - 1))
            if info.max is not None:
                values.append(str(info.max + 1))
            return values
        return [] if name in FREE else ["@@"]

    def writes(info):
        return getattr(info.callback, "__name__", "").startswith("output")

    def call(words):
        sys.argv = ["counterflex", *words]
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                start.run()
                status = 0
            except SystemExit as end:
                status = end.code
        return status, err.getvalue()

    def others(hints, without):
        # what must be given besides, so that a number that is only checked when all is parsed is met
        words = []
        for name, hint in hints.items():
            if name in ("return", without) or typing.get_origin(hint) is not typing.Annotated:
                continue
            base, info, *_ = typing.get_args(hint)
            required = name in needed
            if not required:
                continue
            given = {"to": "h:1", "peer": "h:1", "listen": "h:1", "value": "1", "recipe": "payload"}
            given |= {"target": "file.txt", "joints_deg": "0,0,0,0,0,0", "language": "krl"}
            given |= {"robot": "kuka_kr300_r2500_ultra", "keys": "sensor.range_n", "country": "DE"}
            value = given.get(name)
            if value is None:
                folder = getattr(info.callback, "__name__", "") in ("folder",)
                value = "out" if writes(info) else "." if folder else "file.txt"
            words += [value] if type(info).__name__ == "ArgumentInfo" else [flag(name, info), value]
        return words

    def flag(name, info):
        decls = [d for d in (info.param_decls or ()) if d.startswith("--")]
        default = getattr(info, "default", ...)
        if isinstance(default, str) and default.startswith("--"):
            return default.split("/")[0]
        return decls[0].split("/")[0] if decls else "--" + name.replace("_", "-")

    import inspect
    Path("file.txt").write_text("")
    answers = []
    for path, function in commands(main.whole()):
        hints = typing.get_type_hints(function, include_extras=True)
        signature = inspect.signature(function)
        needed = {n for n, p in signature.parameters.items() if p.default is inspect.Parameter.empty}
        for name, hint in hints.items():
            if name == "return" or typing.get_origin(hint) is not typing.Annotated:
                continue
            base, info, *_ = typing.get_args(hint)
            argument = type(info).__name__ == "ArgumentInfo"
            for value in bad_values(name, base, info):
                words = [value] if argument else ["%s=%s" % (flag(name, info), value)]
                status, err = call([*path, *words, *others(hints, name)])
                heavy = [m for m in HEAVY if m in sys.modules]
                said_as = name.upper() if argument else flag(name, info)
                answers.append([" ".join(path), said_as, value, status, err, heavy])
                if heavy:
                    print(json.dumps(answers)); sys.exit()
    print(json.dumps(answers))
    """
)


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Command, parameter, value, exit status, what was said, heavy modules loaded by then."""
    folder = tmp_path_factory.mktemp("walk")
    script = f"HEAVY = {HEAVY!r}\n{WALK}"
    ended = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert sorted(item.name for item in folder.iterdir()) == ["file.txt"]
    found: list[Any] = json.loads(ended.stdout)
    return found


@pytest.mark.long
def test_nothing_heavy_is_loaded_before_a_fault_is_told(answers: list[Any]) -> None:
    assert [item for item in answers if item[5]] == []
    assert len(answers) > 250
    assert len({command for command, *_ in answers}) > 35


def test_each_is_one_line_and_status_2(answers: list[Any]) -> None:
    wrong = [item for item in answers if item[3] != 2 or item[4].count("\n") != 1 or not item[4].startswith("error: ")]
    assert wrong == []


def test_the_line_names_what_is_wrong(answers: list[Any]) -> None:
    unnamed = []
    for command, name, value, _, said, _ in answers:
        wanted = "file.txt" if value.startswith("file.txt/") else value
        number = wanted in ("abc", "nan", "inf") or wanted.replace(".", "").replace("-", "").isdigit()
        if wanted not in said and not (number and name in said):
            unnamed.append((command, name, value, said))
    assert unnamed == []


def test_the_command_itself_is_light(tmp_path: Path) -> None:
    script = (
        "import sys; from counterflex.cli import main; main._own(*main._OWN); "
        "print([m for m in sys.modules if '.' not in m])"
    )
    ended = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert not {"numpy", *HEAVY} & set(ended.stdout.replace("'", "").strip("[]\n").split(", "))


def test_a_command_loads_no_module_of_another() -> None:
    """Only what the called one imports itself: the options of all others take longer to read than it may take."""
    script = (
        "import sys; from counterflex.cli.main import parsed; parsed(['dcc', 'show', '--help']); "
        "print([m for m in sys.modules if m.startswith('counterflex.cli.commands.')])"
    )
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60).stdout
    loaded = set(ast.literal_eval(said.splitlines()[-1]))
    assert "counterflex.cli.commands.standards.dcc" in loaded
    others = {f"counterflex.cli.commands.{name}" for name in ("prove", "run", "log", "campaign", "twin", "inspection")}
    assert not loaded & others
