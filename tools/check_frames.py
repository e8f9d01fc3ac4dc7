"""Check that neighbouring frame names match: ``T_a_c = T_a_b @ T_b_c`` is right, ``T_a_b @ T_c_b`` is a fault.

Reads every product of names like ``T_a_b``, ``R_a_b``, ``Ts_a_b`` (also ``.T`` and ``pose.inverse(...)`` of them), the
name the product is given, and ``pose.transform(T_a_b, p_b_c)``. A name whose frames are unknown to the check is
skipped; ``prev seg next last`` are places in a chain, not frames, and match any frame.

    python tools/check_frames.py src tests examples
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

_POSE = re.compile(r"^(?:T|R|Ts|Rs)_([a-z][a-z0-9]*)_([a-z][a-z0-9]*)(?:_[a-z0-9_]+)?$")
_POINT = re.compile(r"^(?:p|ps)_([a-z][a-z0-9]*)(?:_[a-z0-9_]+)?$")

_PLACES = {"prev", "seg", "next", "last"}

Frames = tuple[str, str]


def _same(a: str, b: str) -> bool:
    return a == b or a in _PLACES or b in _PLACES


def _name(node: ast.expr) -> str | None:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return node.attr
    if isinstance(node, ast.Subscript):
        return _name(node.value)
    return None


class Checker(ast.NodeVisitor):
    """Collects the faults of one file."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.faults: list[str] = []
        self.products = 0

    def frames(self, node: ast.expr) -> Frames | None:
        """Outer frames of an expression, None where they are not known."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            left, right = self.frames(node.left), self.frames(node.right)
            if left is None or right is None:
                return None
            self.products += 1
            if not _same(left[1], right[0]):
                self._fault(node, f"product of frames {left[0]}_{left[1]} and {right[0]}_{right[1]}")
            return left[0], right[1]
        if isinstance(node, ast.Attribute) and node.attr == "T":
            inner = self.frames(node.value)
            return inner and (inner[1], inner[0])
        if isinstance(node, ast.Call):
            if _name(node.func) == "inverse" and len(node.args) == 1:
                inner = self.frames(node.args[0])
                return inner and (inner[1], inner[0])
            return None
        name = _name(node)
        match = _POSE.match(name) if name else None
        return (match.group(1), match.group(2)) if match else None

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Check an outermost product; inner ones are checked on the way."""
        if isinstance(node.op, ast.MatMult):
            self.frames(node)
        else:
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Check a product against the name it is given."""
        if isinstance(node.value, ast.BinOp) and len(node.targets) == 1:
            want = self.frames(node.targets[0])
            have = self.frames(node.value)
            if want and have and not (_same(want[0], have[0]) and _same(want[1], have[1])):
                self._fault(node, f"named {want[0]}_{want[1]} but the product is {have[0]}_{have[1]}")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """Check that a transformed point is written in the frame the pose maps from."""
        if _name(node.func) == "transform" and len(node.args) == 2:
            have = self.frames(node.args[0])
            name = _name(node.args[1])
            point = _POINT.match(name) if name else None
            if have and point:
                self.products += 1
                if not _same(point.group(1), have[1]):
                    self._fault(node, f"point in frame {point.group(1)} under pose {have[0]}_{have[1]}")
        self.generic_visit(node)

    def _fault(self, node: ast.expr | ast.stmt, what: str) -> None:
        line = f"{self.file}:{node.lineno}: {what}"
        if line not in self.faults:
            self.faults.append(line)


def check(source: str, file: str) -> Checker:
    """Check one source text."""
    checker = Checker(file)
    checker.visit(ast.parse(source, file))
    return checker


def main(roots: list[str]) -> int:
    """Check all Python files under the roots; print faults; 1 when there are any."""
    files = [path for root in roots for path in sorted(Path(root).rglob("*.py"))]
    checkers = [check(path.read_text(encoding="utf-8"), str(path)) for path in files]
    for checker in checkers:
        for fault in checker.faults:
            print(fault)
    faults = sum(len(checker.faults) for checker in checkers)
    print(f"frame names: {sum(c.products for c in checkers)} products in {len(files)} files, {faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["src", "lab", "tests", "examples", "benchmarks"]))
