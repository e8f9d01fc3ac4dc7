"""FANUC TP against a small evaluator of its own: registers, loops, calls, user and tool frames, offsets, increments."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.fanuc.language.read.reader import read_fanuc
from counterflex.integrations.fanuc.language.read.routine import TpFolder
from counting_programs import NAMES, RANDOM_PROGRAMS, Counting, Op, Text, leaf, name, programs, small
from fanuc_listings import entry, listing

Six = tuple[int, int, int, int, int, int]
Pose = tuple[Rotation, Float]
FRAMES: dict[int, Six] = {1: (100, 20, 5, 0, 0, 30), 2: (-7, 0, 3, 10, -40, 0)}
REGISTERS = {"a": 1, "b": 2, "c": 3, "i1": 11, "i2": 12, "i3": 13}
OWN: Six = (4, 5, 6, 180, 0, 180)
"""P[1] of the main program; those that it calls have others."""
turn = st.sampled_from([(0, 0, 0), (20, 0, 0), (0, 40, 0), (0, 0, -70), (20, -30, 50)])
six = st.builds(lambda p, wpr: (*p, *wpr), st.tuples(small, small, small), turn)
goal = st.tuples(leaf, leaf, leaf)


def pose_of(values: Six) -> Pose:
    """W, P, R about fixed x, y, z."""
    return Rotation.from_euler("xyz", values[3:], degrees=True), np.array(values[:3], dtype=float)


def times(a: Pose, b: Pose) -> Pose:
    return a[0] * b[0], a[1] + a[0].apply(b[1])


def inverse(a: Pose) -> Pose:
    back = a[0].inv()
    return back, -back.apply(a[1])


class Fanuc(Counting):
    """What the program does; places are in the first user frame."""

    def __init__(self) -> None:
        super().__init__()
        self.frames = dict(FRAMES)
        self.frame, self.speed, self.override, self.most = 1, 500, 60, 250
        self.wpr: tuple[int, int, int] = (180, 0, 180)
        self.conditions: dict[str, Six] = {}
        self.here = pose_of((0, 0, 0, 180, 0, 180))

    def computed(self, word: str, one: int, two: int) -> int:
        if word in ("DIV", "MOD"):
            return divmod(one, two)[word == "MOD"]
        return super().computed(word, one, two)

    def user(self) -> Pose:
        return times(inverse(pose_of(FRAMES[1])), pose_of(self.frames[self.frame]))

    def reach(self, target: Pose) -> tuple[Pose, float]:
        self.here = times(self.user(), target)
        return self.here, min(self.speed * self.override / 100, self.most)

    def placed(self, x: int, y: int, z: int) -> tuple[Pose, float]:
        return self.reach(pose_of((x, y, z, *self.wpr)))

    def do_lean(self, wpr: tuple[int, int, int]) -> None:
        self.wpr = wpr

    def do_speed(self, speed: int) -> None:
        self.speed = speed

    def do_override(self, percent: int) -> None:
        self.override = percent

    def do_limit(self, most: int) -> None:
        self.most = most

    def do_frame(self) -> None:
        self.frame = 3 - self.frame

    def do_tools(self, *to: Op) -> None:
        self.do_move(*to)
        self.do_move(*to)

    def do_set_frame(self, values: Six) -> None:
        self.frames[2] = values

    def moved(self, kind: str, by: Six, to: tuple[Op, Op, Op]) -> None:
        values = (*(self.value(one) for one in to), *self.wpr)
        target = pose_of(values)  # type: ignore[arg-type]
        if kind == "offset":
            target = pose_of(tuple(a + b for a, b in zip(values, by, strict=True)))  # type: ignore[arg-type]
        else:
            target = times(target, pose_of(by))
        self.ends.append(self.reach(target))

    def do_displaced(self, kind: str, by: Six, to: tuple[Op, Op, Op]) -> None:
        self.moved(kind, by, to)

    def do_condition(self, kind: str, by: Six) -> None:
        self.conditions[kind] = by

    def do_conditioned(self, kind: str, to: tuple[Op, Op, Op]) -> None:
        if kind in self.conditions:
            self.moved(kind, self.conditions[kind], to)

    def do_step(self, by: tuple[int, int, int]) -> None:
        R, p = times(inverse(self.user()), self.here)
        self.ends.append(self.reach((R, p + by)))

    def do_from_here(self, axis: int, by: int) -> None:
        self.do_step(tuple(by if k == axis else 0 for k in range(3)))  # type: ignore[arg-type]

    def do_own_point(self) -> None:
        self.ends.append(self.reach(pose_of(OWN)))


class FanucText(Text):
    """The program as statements."""

    def __init__(self) -> None:
        super().__init__()
        self.label, self.given = 0, set[str]()

    def name(self, of: str) -> str:
        return f"R[{REGISTERS[super().name(of)]}]"

    def value(self, node: Op) -> str:
        if node[0] in ("DIV", "MOD"):
            return f"({self.value(node[1])} {node[0]} {self.value(node[2])})"
        return super().value(node)

    def labels(self, count: int) -> list[int]:
        self.label += count
        return list(range(self.label - count + 1, self.label + 1))

    @staticmethod
    def six(register: int, values: Six) -> Iterator[str]:
        for k, value in enumerate(values, 1):
            yield f"PR[{register},{k}]=({value})"

    def goal(self, to: tuple[Op, ...]) -> Iterator[str]:
        for k, one in enumerate(to, 1):
            yield f"PR[1,{k}]=({self.value(one)})"

    def do_move(self, *to: Op) -> Iterator[str]:
        yield from [*self.goal(to), "L PR[1] R[30]mm/sec FINE"]

    def do_set(self, target: str, to: Op) -> Iterator[str]:
        yield f"{self.name(target)}=({self.value(to)})"

    def do_add(self, target: str, by: Op) -> Iterator[str]:
        yield f"{self.name(target)}={self.name(target)}+{self.value(by)}"

    def do_lean(self, wpr: tuple[int, int, int]) -> Iterator[str]:
        for k, value in enumerate(wpr, 4):
            yield f"PR[1,{k}]=({value})"

    def do_speed(self, speed: int) -> Iterator[str]:
        yield f"R[30]={speed}"

    def do_override(self, percent: int) -> Iterator[str]:
        yield f"OVERRIDE={percent}%"

    def do_limit(self, most: int) -> Iterator[str]:
        yield f"LINEAR_MAX_SPEED={most}"

    def do_frame(self) -> Iterator[str]:
        yield from ["R[31]=3-R[31]", "UFRAME_NUM=R[31]"]

    def do_tools(self, *to: Op) -> Iterator[str]:
        yield from ["UTOOL_NUM=2", *self.do_move(*to), "UTOOL_NUM=1", *self.do_move(*to)]

    def do_set_frame(self, values: Six) -> Iterator[str]:
        yield from [*self.six(5, values), "UFRAME[2]=PR[5]"]

    def do_displaced(self, kind: str, by: Six, to: tuple[Op, Op, Op]) -> Iterator[str]:
        word = "Offset" if kind == "offset" else "Tool_Offset"
        yield from [*self.six(6, by), *self.goal(to), f"L PR[1] R[30]mm/sec FINE {word},PR[6]"]

    def do_condition(self, kind: str, by: Six) -> Iterator[str]:
        number, word = (2, "OFFSET") if kind == "offset" else (3, "TOOL_OFFSET")
        yield from [*self.six(number, by), f"{word} CONDITION PR[{number}]"]

    def do_conditioned(self, kind: str, to: tuple[Op, Op, Op]) -> Iterator[str]:
        word = "Offset" if kind == "offset" else "Tool_Offset"
        yield from [*self.goal(to), f"L PR[1] R[30]mm/sec FINE {word}"]

    def do_step(self, by: tuple[int, int, int]) -> Iterator[str]:
        yield from [*self.six(4, (*by, 0, 0, 0)), "L PR[4] R[30]mm/sec FINE INC"]

    def do_from_here(self, axis: int, by: int) -> Iterator[str]:
        yield from ["PR[8]=LPOS", f"PR[8,{axis + 1}]=PR[8,{axis + 1}]+({by})", "L PR[8] R[30]mm/sec FINE"]

    def do_own_point(self) -> Iterator[str]:
        yield from ["PR[8]=P[1]", "L PR[8] R[30]mm/sec FINE"]

    def do_if(self, test: Op, then: list[Op], other: list[Op]) -> Iterator[str]:
        yield f"IF ({self.condition(test)}) THEN"
        yield from [*self.lines(then), "ELSE", *self.lines(other), "ENDIF"]

    def do_case(self, of: str, values: list[int], *bodies: list[Op]) -> Iterator[str]:
        *begins, behind = self.labels(4)
        yield f"SELECT {self.name(of)}=({values[0]}),JMP LBL[{begins[0]}]"
        yield from [f"=({values[1]}),JMP LBL[{begins[1]}]", f"ELSE,JMP LBL[{begins[2]}]"]
        for label, body in zip(begins, bodies, strict=True):
            yield from [f"LBL[{label}]", *self.lines(body), f"JMP LBL[{behind}]"]
        yield f"LBL[{behind}]"

    def do_for(self, first: int, last: int, step: int, body: list[Op]) -> Iterator[str]:
        counter = f"R[{REGISTERS[f'i{self.depth + 1}']}]"
        yield f"FOR {counter}=({first}) {'TO' if step > 0 else 'DOWNTO'} ({last})"
        yield from [*self.inside(body), "ENDFOR"]

    def do_loop(self, times: int, body: list[Op]) -> Iterator[str]:
        counter, (begin, end) = f"R[{REGISTERS[f'i{self.depth + 1}']}]", self.labels(2)
        yield from [f"{counter}=0", f"LBL[{begin}]", f"IF {counter}>={times},JMP LBL[{end}]", f"{counter}={counter}+1"]
        yield from [*self.inside(body), f"JMP LBL[{begin}]", f"LBL[{end}]"]

    def do_call(self, target: str, given: Op) -> Iterator[str]:
        yield from [f"CALL CUT({self.name(target)},{self.value(given)})", f"{self.name(target)}=R[20]"]


def source(ops: list[Op]) -> str:
    """The program behind a motion in the first user frame."""
    text = FanucText()
    head = [f"R[{REGISTERS[n]}]={value}" for n, value in Counting().at.items()]
    for number, values in FRAMES.items():
        head += [*text.six(5, values), f"UFRAME[{number}]=PR[5]"]
    head += ["OVERRIDE=60%", "LINEAR_MAX_SPEED=250"]
    conditions = [line for kind in ("offset", "tool") for line in text.do_condition(kind, (0, 0, 0, 0, 0, 0))]
    head += [*conditions, "UFRAME_NUM=1", "UTOOL_NUM=1", "R[30]=500", "R[31]=1", *text.six(1, (0, 0, 0, 180, 0, 180))]
    return listing(*head, "J PR[1] 20% FINE", *text.lines(ops), entries=entry(1, *OWN[:3]))


@pytest.fixture(scope="module")
def called(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Programs that are called: each uses its arguments behind the call of another one."""
    folder = tmp_path_factory.mktemp("called")
    move = "L PR[1] R[30]mm/sec FINE"
    cut = listing("R[21]=AR[2]+1", "CALL INNER(R[21],7)", "PR[8]=P[1]", "PR[1,1]=AR[1]", "PR[1,2]=AR[2]+1",
                  "PR[1,3]=PR[8,3]", move, "R[20]=AR[1]-AR[2]-1", entries=entry(1, 0, 0, 1))  # fmt: skip
    inner = listing("R[22]=2*AR[1]", "PR[8]=P[1]", "PR[1,1]=R[22]", "PR[1,2]=R[22]", "PR[1,3]=PR[8,3]", move,
                    entries=entry(1, 0, 0, 2))  # fmt: skip
    for program, text in (("CUT", cut), ("INNER", inner)):
        (folder / f"{program}.ls").write_text(text.replace("PART", program))
    return sorted(folder.iterdir())


kind = st.sampled_from(["offset", "tool"])
WHOLE = st.tuples(st.sampled_from(["DIV", "MOD"]), st.tuples(st.just("n"), st.integers(0, 99)),
                  st.tuples(st.just("n"), st.integers(1, 9)))  # fmt: skip
PROGRAMS = programs(
    st.tuples(st.just("set"), name, WHOLE), st.tuples(st.just("lean"), turn),
    st.tuples(st.just("speed"), st.integers(1, 900)), st.tuples(st.just("override"), st.integers(1, 100)),
    st.tuples(st.just("limit"), st.integers(5, 900)), st.tuples(st.just("frame")),
    st.tuples(st.just("tools"), leaf, leaf, leaf), st.tuples(st.just("set_frame"), six),
    st.tuples(st.just("displaced"), kind, six, goal), st.tuples(st.just("condition"), kind, six),
    st.tuples(st.just("conditioned"), kind, goal), st.tuples(st.just("step"), st.tuples(small, small, small)),
    st.tuples(st.just("from_here"), st.integers(0, 2), small), st.tuples(st.just("own_point")), steps=(1, -1),
)  # fmt: skip


@RANDOM_PROGRAMS
@given(PROGRAMS)
def test_a_program_makes_the_motions_of_the_reference(called: list[Path], ops: list[Op]) -> None:
    """Places, orientations and speeds of every motion, in whatever frame and condition was left before it."""
    ops = [*ops, *(("move", ("v", n), ("n", 0), ("n", 7)) for n in NAMES)]
    reference = Fanuc()
    reference.conditions = {"offset": (0,) * 6, "tool": (0,) * 6}
    reference.run(ops)
    assume(reference.is_small())
    made = read_fanuc(source(ops), name="part.ls", folder=TpFolder(called))
    assert made.Rs_part_tcp is not None
    assert len(made.motions) == len(reference.ends) + 1
    for motion, R, ((turned, p), speed) in zip(made.motions[1:], made.Rs_part_tcp[1:], reference.ends, strict=True):
        np.testing.assert_allclose(np.asarray(motion.p_end) / MM, p, atol=1e-6)
        np.testing.assert_allclose(R, turned.as_matrix(), atol=1e-9)
        assert motion.feed_m_s / MM == pytest.approx(speed, rel=1e-9)
