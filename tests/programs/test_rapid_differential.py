"""RAPID against a small evaluator of its own: counts, bits, branches, loops, calls, displacements and work objects."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.abb.language.read.reader import read_rapid
from counting_programs import NAMES, NEVER, RANDOM_PROGRAMS, Counting, Op, Text, leaf, name, programs, small

Pose = tuple[Rotation, Float]
REST = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
OBJECTS = {
    "w1": ((100, 0, 5), (20, 0, 0), (0, 7, 0), (0, 0, 30)),
    "w2": ((-7, 40, 0), (0, 30, 0), (3, 0, 9), (50, 0, 0)),
}
"""Places, mm, and angles about z, y, x, deg, of user and object frames."""
turn = st.sampled_from([(0, 0, 0), (90, 0, 0), (0, 40, 0), (0, 0, -70), (20, -30, 50)])
place = st.tuples(small, small, small)


def frame(p: tuple[int, ...], zyx: tuple[int, ...]) -> Pose:
    return Rotation.from_euler("ZYX", zyx, degrees=True), np.array(p, dtype=float)


def times(a: Pose, b: Pose) -> Pose:
    return a[0] * b[0], a[1] + a[0].apply(b[1])


def inverse(a: Pose) -> Pose:
    back = a[0].inv()
    return back, -back.apply(a[1])


STANDS = frame((0, 0, 0), (0, 0, 0))


class Rapid(Counting):
    """What the program does."""

    def __init__(self) -> None:
        super().__init__()
        self.at |= {"m": 0, "v": 500}
        self.displaced, self.object, self.tilt, self.factor, self.most = STANDS, STANDS, (0, STANDS), 60, 250

    def computed(self, word: str, one: int, two: int) -> int:
        if word == "DIV":
            return math.trunc(one / two)
        if word == "MOD":
            return int(math.fmod(one, two))
        return super().computed(word, one, two)

    def target(self, x: int, y: int, z: int) -> Pose:
        along, turned = self.tilt
        there = frame((x, y, z), (0, 0, 180))
        return times(times(there, frame((0, 0, along), (0, 0, 0))), turned)

    def placed(self, x: int, y: int, z: int) -> tuple[Pose, float]:
        speed = min(self.at["v"] * self.factor / 100, self.most)
        return times(self.object, times(self.displaced, self.target(x, y, z))), speed

    def do_clear(self, target: str) -> None:
        self.at[target] = 0

    def do_bit(self, number: int, on: bool) -> None:
        bits = [self.at["m"] // 2**k % 2 for k in range(8)]
        bits[number - 1] = int(on)
        self.at["m"] = sum(bit * 2**k for k, bit in enumerate(bits))

    def do_speed(self, speed: int) -> None:
        self.at["v"] = speed

    def do_limits(self, factor: int, most: int) -> None:
        self.factor, self.most = factor, most

    def do_shift(self, p: tuple[int, ...], zyx: tuple[int, ...]) -> None:
        self.displaced = frame(p, zyx)

    def do_measured(self, rotates: bool, p: tuple[int, ...], zyx: tuple[int, ...]) -> None:
        there, here = frame(p, zyx), frame((1, 2, 3), (0, 0, 180))
        self.displaced = times(there, inverse(here)) if rotates else (STANDS[0], there[1] - here[1])

    def do_unshift(self) -> None:
        self.displaced = STANDS

    def do_use(self, word: str) -> None:
        user = [frame(*pair) for pair in zip(OBJECTS[word][::2], OBJECTS[word][1::2], strict=True)] if word else []
        self.object = times(*user) if user else STANDS

    def do_lean(self, along: int, xyz: tuple[int, ...]) -> None:
        self.tilt = along, (Rotation.from_euler("XYZ", xyz, degrees=True), np.zeros(3))


class RapidText(Text):
    """The program in RAPID."""

    def __init__(self) -> None:
        super().__init__()
        self.lean = "0"
        self.object = ""

    def name(self, of: str) -> str:
        return ("i" if self.depth else "a") if of == "i" else of  # a counter hides that of the loop around it

    def value(self, node: Op) -> str:
        if node[0] in ("DIV", "MOD"):
            return f"({self.value(node[1])} {node[0]} {self.value(node[2])})"
        return super().value(node)

    def motion(self, x: str, y: str, z: str) -> str:
        return f"Go {x},{y},{z};"

    def do_move(self, *to: Op) -> Iterator[str]:
        yield self.motion(*(self.value(one) for one in to))

    def do_set(self, target: str, to: Op) -> Iterator[str]:
        yield f"{target}:={self.value(to)};"

    def do_add(self, target: str, by: Op) -> Iterator[str]:
        word = {("n", 1): "Incr {0};", ("n", -1): "Decr {0};"}.get(by, "Add {0},{1};")
        yield word.format(target, self.value(by))

    def do_clear(self, target: str) -> Iterator[str]:
        yield f"Clear {target};"

    def do_bit(self, number: int, on: bool) -> Iterator[str]:
        yield f"Bit{'Set' if on else 'Clear'} m,{number};"

    def do_speed(self, speed: int) -> Iterator[str]:
        yield f"s.v_tcp:={speed};"

    def do_limits(self, factor: int, most: int) -> Iterator[str]:
        yield f"VelSet {factor},{most};"

    def do_shift(self, p: tuple[int, ...], zyx: tuple[int, ...]) -> Iterator[str]:
        yield f"PDispSet [{list(p)},OrientZYX{zyx}];"

    def do_measured(self, rotates: bool, p: tuple[int, ...], zyx: tuple[int, ...]) -> Iterator[str]:
        yield f"PDispOff;\nq.trans:={list(p)};\nq.rot:=OrientZYX{zyx};"
        yield f"PDispOn{chr(92) + 'Rot' if rotates else ''}\\ExeP:=q,Offs(p10,1,2,3),tool0;"

    def do_unshift(self) -> Iterator[str]:
        yield "PDispOff;"

    def do_use(self, word: str) -> Iterator[str]:
        yield f"used:={int(word[1:] or 0)};"

    def do_lean(self, along: int, xyz: tuple[int, ...]) -> Iterator[str]:
        yield f"along:={along};\nrx:={xyz[0]};\nry:={xyz[1]};\nrz:={xyz[2]};"

    def do_if(self, test: Op, then: list[Op], other: list[Op]) -> Iterator[str]:
        yield f"IF {self.condition(test)} THEN"
        yield from [*self.lines(then), "ELSE", *self.lines(other), "ENDIF"]

    def do_case(self, of: str, values: list[int], *bodies: list[Op]) -> Iterator[str]:
        yield f"TEST {of}"
        for word, body in zip((f"CASE {NEVER},{values[0]}:", f"CASE {values[1]}:", "DEFAULT:"), bodies, strict=True):
            yield from [word, *self.lines(body)]
        yield "ENDTEST"

    def do_for(self, first: int, last: int, step: int, body: list[Op]) -> Iterator[str]:
        yield f"FOR i FROM {first} TO {last} STEP {step} DO"
        yield from [*self.inside(body), "ENDFOR"]

    def do_loop(self, times: int, body: list[Op]) -> Iterator[str]:
        yield f"Begin{self.depth};\nk{self.depth}:=0;\nWHILE k{self.depth}<{times} DO\nIncr k{self.depth};"
        yield f"FOR i FROM k{self.depth} TO k{self.depth} DO"
        yield from [*self.inside(body), "ENDFOR\nENDWHILE"]

    def do_call(self, target: str, given: Op) -> Iterator[str]:
        yield f"Cut {target},{self.value(given)};"


def module(ops: list[Op], first: int) -> str:
    """The program as a module; most motions are in wobj0, which is so the frame of the part."""
    body = "\n".join(RapidText().lines(ops))
    data = "".join(f"VAR num {n}:={value};\n" for n, value in Counting().at.items())
    data += "".join(f"VAR num {n}:=0;\n" for n in ("along", "rx", "ry", "rz", "used", "k0", "k1", "k2"))
    for word, (p, zyx, p_object, zyx_object) in OBJECTS.items():
        q = [[float(v) for v in Rotation.from_euler("ZYX", a, True).as_quat(scalar_first=True)]
             for a in (zyx, zyx_object)]  # fmt: skip
        data += f'PERS wobjdata {word}:=[FALSE,TRUE,"",[{list(p)},{q[0]}],[{list(p_object)},{q[1]}]];\n'
    goal = "RelTool(Offs(p10,x,y,z),0,0,along\\Rx:=rx\\Ry:=ry\\Rz:=rz),s,fine,tool0"
    go = f"MoveL {goal}\\WObj:=w1;\nCASE 2:\nMoveL {goal}\\WObj:=w2;\nDEFAULT:\nMoveL {goal};\nENDTEST\n"
    return (
        f"MODULE m\nCONST robtarget p10:=[[0,0,0],[0,1,0,0],{REST}];\nVAR robtarget q:=[[0,0,0],[0,1,0,0],{REST}];\n"
        f"VAR byte m:=0;\nVAR speeddata s:=[500,1000000,5000,1000];\n{data}"
        f"PROC main()\nFOR n FROM 1 TO {first} DO\nMoveJ p10,v100,fine,tool0;\nENDFOR\nVelSet 60,250;\n"
        f"{body}\nENDPROC\n"
        f"PROC Go(num x,num y,num z)\nTEST used\nCASE 1:\n{go}ENDPROC\n"
        "PROC Begin0()\nENDPROC\nPROC Begin1()\nENDPROC\nPROC Begin2()\nENDPROC\n"
        "PROC Inner(num y)\ny:=2*y;\nGo y,y,2;\nENDPROC\n"
        "PROC Cut(INOUT num x,num y)\ny:=more(y);\nInner y;\nGo x,y,1;\nx:=x-y;\nENDPROC\n"
        "FUNC num more(num y)\ny:=y+1;\nRETURN y;\nENDFUNC\nENDMODULE\n"
    )


WHOLE = st.tuples(st.sampled_from(["DIV", "MOD"]), leaf, st.tuples(st.just("n"), small.filter(bool)))
BIT = st.tuples(st.just("bit"), st.integers(1, 8), st.booleans())
PROGRAMS = programs(
    BIT, BIT, st.tuples(st.just("set"), name, st.one_of(WHOLE, st.just(("v", "m")))),
    st.tuples(st.just("clear"), name), st.tuples(st.just("add"), name, st.sampled_from([("n", 1), ("n", -1)])),
    st.tuples(st.just("speed"), st.integers(1, 900)),
    st.tuples(st.just("limits"), st.integers(1, 100), st.integers(50, 900)),
    st.tuples(st.just("shift"), place, turn), st.tuples(st.just("measured"), st.booleans(), place, turn),
    st.tuples(st.just("unshift")), st.tuples(st.just("use"), st.sampled_from(["w1", "w2", ""])),
    st.tuples(st.just("lean"), small, turn),
)  # fmt: skip


@RANDOM_PROGRAMS
@given(PROGRAMS)
def test_a_program_makes_the_motions_of_the_reference(ops: list[Op]) -> None:
    """Places, orientations and speeds of every motion, whatever was counted, displaced and called before it.

    v_ori is beyond every turn: the reference knows speeds along the path alone.
    """
    ops = [*ops, *(("move", ("v", n), ("n", 0), ("v", "m")) for n in NAMES)]
    reference = Rapid()
    reference.run(ops)
    assume(reference.is_small())
    first = len(reference.ends) + 1
    made = read_rapid(module(ops, first), name="m.mod")
    motions = made.motions[first:]
    assert made.Rs_part_tcp is not None
    assert len(motions) == len(reference.ends)
    for motion, R, ((turned, p), speed) in zip(motions, made.Rs_part_tcp[first:], reference.ends, strict=True):
        np.testing.assert_allclose(np.asarray(motion.p_end) / MM, p, atol=1e-6)
        np.testing.assert_allclose(R, turned.as_matrix(), atol=1e-9)
        assert motion.feed_m_s / MM == pytest.approx(speed, rel=1e-9)
