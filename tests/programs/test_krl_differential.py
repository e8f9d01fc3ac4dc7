"""KRL against a small evaluator of its own: counts, bits, loops, calls, bases, one motion's own modes, INITMOV."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.kuka.language.read.reader import read_krl
from counting_programs import NAMES, NEVER, RANDOM_PROGRAMS, Counting, Op, Text, expression, leaf, name, programs, small

Six = tuple[int, int, int, int, int, int]
FIRST: Six = (100, 20, 5, 30, 0, 0)
OTHER: Six = (-7, 0, 3, 0, -40, 10)
CONFIG = {
    "$config.dat": "DEFDAT  $CONFIG\nREAL DEF_VEL_CP=1.5\nBASE_DATA[2]="
    + "{X -7,Y 0,Z 3,A 0,B -40,C 10}\nENDDAT\n"
}  # fmt: skip
DATA = "DEFDAT p\nINT NRA=0\nINT NRB=0\nINT NRC=0\nENDDAT\n"
turn = st.sampled_from([(0, 0, 0), (90, 0, 0), (0, 40, 0), (0, 0, -70), (20, -30, 50)])
six = st.builds(lambda p, abc: (*p, *abc), st.tuples(small, small, small), turn)


def pose_of(values: Six) -> tuple[Rotation, Float]:
    """Rotation about z, then the new y, then the new x, and place in mm."""
    return Rotation.from_euler("ZYX", values[3:], degrees=True), np.array(values[:3], dtype=float)


def literal(values: Six) -> str:
    return "{" + ",".join(f"{letter} {value}" for letter, value in zip("XYZABC", values, strict=True)) + "}"


class Krl(Counting):
    """What the program does; ``base`` and places are those of the first base."""

    def __init__(self) -> None:
        super().__init__()
        self.base, self.speed, self.override, self.holds = FIRST, 20, 60, False
        self.angles = (0, 0, 180)
        self.here = pose_of((0, 0, 0, 0, 0, 180))

    def computed(self, word: str, one: int, two: int) -> int:
        if word == "/":
            return math.trunc(one / two)
        if word[:2] == "B_":
            return {"B_AND": one & two, "B_OR": one | two, "B_EXOR": one ^ two}[word]
        return super().computed(word, one, two)

    def in_part(self) -> tuple[Rotation, Float]:
        """The active base in the first one."""
        (R_first, p_first), (R, p) = pose_of(FIRST), pose_of(self.base)
        return R_first.inv() * R, R_first.inv().apply(p - p_first)

    def placed(self, x: int, y: int, z: int) -> tuple[Rotation, Float, float]:
        R_base, p_base = self.in_part()
        R, p = pose_of((x, y, z, *self.angles))
        R = self.here[0] if self.holds else R_base * R
        self.here = R, p_base + R_base.apply(p)
        return *self.here, self.speed * self.override / 100

    def do_angles(self, abc: tuple[int, int, int]) -> None:
        self.angles = abc

    def do_speed(self, speed: int) -> None:
        self.speed = speed

    def do_override(self, percent: int) -> None:
        self.override = percent

    def do_base(self, values: Six) -> None:
        self.base = values

    def do_numbered(self) -> None:
        self.base = OTHER

    def do_component(self, index: int, value: int) -> None:
        before = self.base
        self.base = (*before[:index], value, *before[index + 1 :])  # type: ignore[assignment]

    def do_hold(self, on: bool) -> None:
        self.holds = on

    def do_initialise(self, values: Six, speed: int) -> None:
        """Back to the world, the speed of the controller and turning tools; then what the program sets again."""
        self.base, self.holds, self.speed = (values[0], 0, 0, 0, 0, 0), False, speed or 1500

    def do_own(self, kind: str, values: Six, to: tuple[Op, Op, Op]) -> None:
        """A motion with a value of its own."""
        before = self.base, self.speed, self.holds
        if kind == "$BASE":
            self.base = values
        elif kind == "$VEL.CP":
            self.speed = abs(values[0]) + 1
        else:
            self.holds = not self.holds
        self.do_move(*to)
        self.base, self.speed, self.holds = before

    def do_partly(self, axis: int, value: Op) -> None:
        """A motion of one component: the others stay where they are in the active base, the tool as it is held."""
        R_base, p_base = self.in_part()
        p = R_base.inv().apply(self.here[1] - p_base)
        p[axis] = self.value(value)
        self.here = self.here[0], p_base + R_base.apply(p)
        self.ends.append((*self.here, self.speed * self.override / 100))

    def do_relative(self, axis: int, by: int, in_tool: bool) -> None:
        way = np.zeros(3)
        way[axis] = by
        R = self.here[0] if in_tool else self.in_part()[0]
        self.here = self.here[0], self.here[1] + R.apply(way)
        self.ends.append((*self.here, self.speed * self.override / 100))


class KrlText(Text):
    """The program in KRL."""

    equal = "=="

    def name(self, of: str) -> str:
        return f"N{super().name(of)}"

    def value(self, node: Op) -> str:
        if node[0][:2] == "B_":
            return f"({self.value(node[1])} {node[0]} {self.value(node[2])})"
        return super().value(node)

    def goal(self, to: tuple[Op, ...]) -> str:
        x, y, z = (self.value(one) for one in to)
        return f"{{X {x},Y {y},Z {z},A NRA,B NRB,C NRC}}"

    def do_move(self, *to: Op) -> Iterator[str]:
        yield f"LIN {self.goal(to)}"

    def do_set(self, target: str, to: Op) -> Iterator[str]:
        yield f"{self.name(target)}={self.value(to)}"

    def do_add(self, target: str, by: Op) -> Iterator[str]:
        yield f"{self.name(target)}={self.name(target)}+{self.value(by)}"

    def do_angles(self, abc: tuple[int, int, int]) -> Iterator[str]:
        yield f"NRA={abc[0]}\nNRB={abc[1]}\nNRC={abc[2]}"

    def do_speed(self, speed: int) -> Iterator[str]:
        yield f"$VEL.CP={speed}/1000.0"

    def do_override(self, percent: int) -> Iterator[str]:
        yield f"$OV_PRO={percent}"

    def do_base(self, values: Six) -> Iterator[str]:
        yield f"$BASE={literal(values)}"

    def do_numbered(self) -> Iterator[str]:
        yield "BAS(#BASE,2)"

    def do_component(self, index: int, value: int) -> Iterator[str]:
        yield f"$BASE.{'XYZABC'[index]}={value}"

    def do_hold(self, on: bool) -> Iterator[str]:
        yield f"$ORI_TYPE=#{'CONSTANT' if on else 'VAR'}"

    def do_initialise(self, values: Six, speed: int) -> Iterator[str]:
        yield f"BAS(#INITMOV,0)\n$BASE.X={values[0]}"
        if speed:
            yield f"$VEL.CP={speed}/1000.0"

    def do_own(self, kind: str, values: Six, to: tuple[Op, Op, Op]) -> Iterator[str]:
        if kind != "$ORI_TYPE":
            given = literal(values) if kind == "$BASE" else f"{abs(values[0]) + 1}/1000.0"
            yield f"SLIN {self.goal(to)} WITH {kind}={given}"
            return
        yield "IF $ORI_TYPE==#VAR THEN"
        yield f"SLIN {self.goal(to)} WITH {kind}=#CONSTANT\nELSE\nSLIN {self.goal(to)} WITH {kind}=#VAR\nENDIF"

    def do_partly(self, axis: int, value: Op) -> Iterator[str]:
        yield f"LIN {{{'XYZ'[axis]} {self.value(value)}}}"

    def do_relative(self, axis: int, by: int, in_tool: bool) -> Iterator[str]:
        yield f"LIN_REL {{{'XYZ'[axis]} {by}}}{' #TOOL' if in_tool else ''}"

    def do_if(self, test: Op, then: list[Op], other: list[Op]) -> Iterator[str]:
        yield f"IF {self.condition(test)} THEN"
        yield from [*self.lines(then), "ELSE", *self.lines(other), "ENDIF"]

    def do_case(self, of: str, values: list[int], *bodies: list[Op]) -> Iterator[str]:
        yield f"SWITCH {self.name(of)}"
        for word, body in zip((f"CASE {NEVER},{values[0]}", f"CASE {values[1]}", "DEFAULT"), bodies, strict=True):
            yield from [word, *self.lines(body)]
        yield "ENDSWITCH"

    def do_for(self, first: int, last: int, step: int, body: list[Op]) -> Iterator[str]:
        yield f"FOR NI{self.depth + 1}={first} TO {last} STEP {step}"
        yield from [*self.inside(body), "ENDFOR"]

    def do_loop(self, times: int, body: list[Op]) -> Iterator[str]:
        counter = f"NI{self.depth + 1}"
        inside = [f"{counter}={counter}+1", *self.inside(body)]
        yield f"{counter}=0"
        if times == 2:
            yield from [f"WHILE {counter}<2", *inside, "ENDWHILE"]
        elif times == 3:
            yield from ["REPEAT", *inside, f"UNTIL {counter}>=3"]
        else:
            yield from ["LOOP", f"IF {counter}>={times} THEN\nEXIT\nENDIF", *inside, "ENDLOOP"]

    def do_call(self, target: str, given: Op) -> Iterator[str]:
        yield f"CUT({self.name(target)},{self.value(given)})"


SUBS = (
    "DEF INNER(Y:IN)\nINT Y\nY=2*Y\nLIN {X Y,Y Y,Z 2,A NRA,B NRB,C NRC}\nEND\n"
    "DEF CUT(X:OUT,Y:IN)\nINT X,Y\nY=MORE(Y)\nINNER(Y)\nLIN {X X,Y Y,Z 1,A NRA,B NRB,C NRC}\nX=X-Y\nEND\n"
    "DEFFCT INT MORE(Y:IN)\nINT Y\nY=Y+1\nRETURN Y\nENDFCT\n"
)


def source(ops: list[Op]) -> str:
    """The program behind a motion in the first base."""
    numbers = "".join(f"N{n}={value}\n" for n, value in Counting().at.items())
    head = f"INT Na,Nb,Nc,Ni1,Ni2,Ni3\n{numbers}NRA=0\nNRB=0\nNRC=180\n$TOOL=TOOL_DATA[1]\n$BASE={literal(FIRST)}\n"
    return f"DEF p( )\n{head}$VEL.CP=0.02\n$OV_PRO=60\nPTP {{X 0,Y 0,Z 0,A 0,B 0,C 180}}\n" + "\n".join(
        [*KrlText().lines(ops), "END\n" + SUBS]
    )


QUOTIENT = st.tuples(st.just("/"), leaf, st.tuples(st.just("n"), small.filter(bool)))
BITS = st.tuples(st.sampled_from(["B_AND", "B_OR", "B_EXOR"]), *[st.tuples(st.just("n"), st.integers(0, 255))] * 2)
goal = st.tuples(leaf, leaf, leaf)
PROGRAMS = programs(
    st.tuples(st.just("set"), name, st.one_of(QUOTIENT, BITS)), st.tuples(st.just("angles"), turn),
    st.tuples(st.just("speed"), st.integers(1, 900)), st.tuples(st.just("override"), st.integers(1, 100)),
    st.tuples(st.just("base"), six), st.tuples(st.just("numbered")),
    st.tuples(st.just("component"), st.integers(0, 5), small), st.tuples(st.just("hold"), st.booleans()),
    st.tuples(st.just("initialise"), six, st.sampled_from([0, 30])),
    st.tuples(st.just("own"), st.sampled_from(["$BASE", "$VEL.CP", "$ORI_TYPE"]), six, goal),
    st.tuples(st.just("partly"), st.integers(0, 2), expression),
    st.tuples(st.just("relative"), st.integers(0, 2), small, st.booleans()),
)  # fmt: skip


@pytest.mark.long
@RANDOM_PROGRAMS
@given(PROGRAMS)
def test_a_program_makes_the_motions_of_the_reference(ops: list[Op]) -> None:
    """Places, orientations and speeds of every motion, in whatever base and mode was left by what ran before."""
    ops = [*ops, *(("move", ("v", n), ("n", 0), ("n", 7)) for n in NAMES)]
    reference = Krl()
    reference.run(ops)
    assume(reference.is_small())
    made = read_krl(source(ops), name="p.src", data=DATA, data_name="p.dat", folder=CONFIG)
    assert made.Rs_part_tcp is not None
    assert len(made.motions) == len(reference.ends) + 1
    for motion, R, (turned, p, speed) in zip(made.motions[1:], made.Rs_part_tcp[1:], reference.ends, strict=True):
        np.testing.assert_allclose(np.asarray(motion.p_end) / MM, p, atol=1e-6)
        np.testing.assert_allclose(R, turned.as_matrix(), atol=1e-9)
        assert motion.feed_m_s / MM == pytest.approx(speed, rel=1e-9)
