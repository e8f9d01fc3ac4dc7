"""Post-processor of FreeCAD's CAM workbench: the job goes through counterflex and returns compensated.

Runs on FreeCAD's Python and imports nothing of counterflex, which it starts as a program of its own. FreeCAD's own
post-processor for LinuxCNC says the job in G-code; this one adds what a check needs and FreeCAD leaves out: the
diameter of each tool.
"""

from __future__ import annotations

import argparse
import importlib
import json
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

COUNTERFLEX = ["counterflex"]

# Names that FreeCAD reads
TOOLTIP = "Compensates the job for the robot of a counterflex cell file and writes it in the robot's language."
TOOLTIP_ARGS = """--cell=FILE: cell file (.toml), needed
--as=LANGUAGE: krl, rapid, fanuc, val3, inform or gcode
--results=DIR: folder for report, plan and summary; without it NAME-counterflex beside the program
--without-preflight: go on where 'counterflex preflight' finds a failure
--counterflex=FILE: another counterflex than the one that wrote this file
all other arguments go to 'counterflex compensate'"""

_OWN_POSTS = ("PathScripts.post.linuxcnc_post", "Path.Post.scripts.linuxcnc_post")  # to 0.20, from 0.21
_NO_FILE = "-"


def export(objectslist: list[Any], filename: str, argstring: str) -> str:
    """Write the compensated program and return its text.

    Args:
        objectslist: Operations and tool controllers of the job, in their order.
        filename: Of the program; ``-`` writes none.
        argstring: Arguments of the job, see ``TOOLTIP_ARGS``.

    Raises:
        RuntimeError: counterflex refuses the job; its message is that of counterflex.
    """
    options, others = _arguments(argstring)
    call = [options.counterflex] if options.counterflex else COUNTERFLEX
    target = None if filename == _NO_FILE else Path(filename).absolute()
    with tempfile.TemporaryDirectory() as made:
        source = Path(made, "job.ngc" if target is None else target.stem + ".ngc")
        source.write_text(_gcode(objectslist), encoding="utf-8")
        cell = ["--cell", options.cell]
        language = ["--as", options.language] if options.language else []
        if not options.without_preflight:
            checks = Path(made, "preflight")
            words = [*call, "preflight", str(source), *cell, *language, "--out", str(checks)]
            _run(words, "does not pass the check before the cut")
            _refuse_another_tool(json.loads((checks / "summary.json").read_text(encoding="utf-8"))["checks"])
        out = Path(made, "out") if target is None else target.with_name(target.stem + "-counterflex")
        if options.results:
            out = Path(options.results)
        _run([*call, "compensate", str(source), *cell, *language, "--out", str(out), *others], "cannot be compensated")
        return _taken(out, target)


def _refuse_another_tool(checks: list[Any]) -> None:
    """Refuse a tool of another diameter than in the cell: a warning for a comment, here the job itself says it."""
    for row in checks:
        if row["check"] == "tool of the program" and row["verdict"] == "warning":
            raise RuntimeError(f"counterflex: the job has another tool than the cell file: {row['what']}")


def _arguments(argstring: str) -> tuple[argparse.Namespace, list[str]]:
    """Split the job's arguments into our own and those of ``compensate``."""
    reader = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    for name in ("--cell", "--results", "--counterflex"):
        reader.add_argument(name)
    reader.add_argument("--as", dest="language")
    reader.add_argument("--without-preflight", action="store_true")
    words = shlex.shlex(argstring, posix=True, punctuation_chars=False)
    words.whitespace_split, words.escape, words.commenters = True, "", ""  # the backslash parts folders on Windows
    # FreeCAD adds this word of its own posts to the arguments of every job
    options, others = reader.parse_known_args([word for word in words if word != "--no-show-editor"])
    if options.cell is None:
        raise RuntimeError("counterflex: the job names no cell file. Write --cell=CELL.toml into its arguments")
    return options, others


def _gcode(objectslist: list[Any]) -> str:
    """G-code of the job by FreeCAD, behind the diameter of each tool, mm."""
    post = next(filter(None, map(_imported, _OWN_POSTS)), None)
    if post is None:
        raise RuntimeError(f"counterflex: this FreeCAD has no post-processor for LinuxCNC: not {', '.join(_OWN_POSTS)}")
    text = post.export(objectslist, _NO_FILE, "--no-show-editor")
    if not text:
        raise RuntimeError("counterflex: FreeCAD's post-processor for LinuxCNC made nothing of the job")
    tools = {int(thing.ToolNumber): thing.Tool for thing in objectslist if hasattr(thing, "ToolNumber")}
    sizes = {number: tool.Diameter for number, tool in sorted(tools.items()) if hasattr(tool, "Diameter")}
    remarks = [f"(T{number} D={float(getattr(size, 'Value', size)):g} mm)\n" for number, size in sizes.items()]
    return "".join(remarks) + str(text)


def _imported(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _run(call: list[str], what: str) -> None:
    """Run counterflex and print what it prints."""
    done = subprocess.run(
        call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", errors="replace", check=False
    )
    print(done.stdout)
    if done.returncode != 0:
        raise RuntimeError(f"counterflex: the job {what}:\n{done.stdout.strip()}")


def _taken(out: Path, target: Path | None) -> str:
    """Text of the program; with a target its files are copied there."""
    files = json.loads((out / "summary.json").read_text(encoding="utf-8"))["files"]
    if target is not None:
        for name in files:
            shutil.copyfile(out / name, target.with_name(name))
        if files[0] != target.name:
            print(f"counterflex: the program is {files[0]}: so the robot's language names it")
    return Path(out, files[0]).read_text(encoding="utf-8")
