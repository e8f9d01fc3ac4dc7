"""VAL3 against a small evaluator of its own: numbers, loops, calls by value and by reference, frames, products."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.staubli.language.read.branches import Val3Folder
from counterflex.integrations.staubli.language.read.reader import read_val3
from counting_programs import NAMES, NEVER, RANDOM_PROGRAMS, Counting, Op, Text, leaf, programs, small
from val3_files import at, data, program

Six = tuple[int, int, int, int, int, int]
Pose = tuple[Rotation, Float]
PART: Six = (100, 0, 0, 0, 0, 90)
"""The frame fPart of the data file in the world."""
WITHIN: Six = (5, -3, 2, 0, 30, 40)
"""The frame fB in fPart."""
THREE = ((0, 0, 0), (5, 1, 2), (-1, 4, 1))
"""From the first of three points of a frame to each of them."""
turn = st.sampled_from([(0, 0, 0), (20, 0, 0), (0, 40, 0), (0, 0, -70), (20, -30, 50)])
six = st.builds(lambda p, angles: (*p, *angles), st.tuples(small, small, small), turn)
goal = st.tuples(leaf, leaf, leaf)


def pose_of(values: Six) -> Pose:
    """Rx, ry, rz about moved axes."""
    return Rotation.from_euler("XYZ", values[3:], degrees=True), np.array(values[:3], dtype=float)


def times(*poses: Pose) -> Pose:
    R, p = poses[0]
    for turned, moved in poses[1:]:
        R, p = R * turned, p + R.apply(moved)
    return R, p


def inverse(a: Pose) -> Pose:
    back = a[0].inv()
    return back, -back.apply(a[1])


def by_points(origin: Float, on_x: Float, in_xy: Float) -> Pose:
    """Frame with x through the second point and the third in its xy plane."""
    x = (on_x - origin) / np.linalg.norm(on_x - origin)
    y = (in_xy - origin) - ((in_xy - origin) @ x) * x
    y /= np.linalg.norm(y)
    return Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)])), origin


class Val3(Counting):
    """What the program does; places are in fPart."""

    def __init__(self) -> None:
        super().__init__()
        self.within, self.father, self.change = pose_of(WITHIN), "fPart", pose_of((0, 0, 0, 0, 0, 0))
        self.angles, self.point, self.speed = (0, 180, 0), (0, 0, 0, 0, 180, 0), 50

    def frame(self) -> Pose:
        return {"fPart": pose_of((0,) * 6), "fB": self.within, "world": inverse(pose_of(PART))}[self.father]

    def reach(self, point: Pose) -> tuple[Pose, int]:
        return times(self.frame(), point), self.speed

    def placed(self, x: int, y: int, z: int) -> tuple[Pose, int]:
        self.point = (x, y, z, *self.angles)
        return self.reach(pose_of(self.point))

    def take(self, to: tuple[Op, Op, Op]) -> Pose:
        self.point = (*(self.value(one) for one in to), *self.angles)  # type: ignore[assignment]
        return pose_of(self.point)

    def do_lean(self, angles: tuple[int, int, int]) -> None:
        self.angles = angles

    def do_speed(self, speed: int) -> None:
        self.speed = speed

    def do_link(self, father: str) -> None:
        self.father = father

    def do_frame(self, values: Six) -> None:
        self.within = pose_of(values)

    def do_set_frame(self, p: tuple[int, int, int]) -> None:
        self.within = by_points(*(np.add(p, by) for by in THREE))

    def do_component(self, axis: int, value: Op) -> None:
        self.point = (*self.point[:axis], self.value(value), *self.point[axis + 1 :])  # type: ignore[assignment]
        self.ends.append(self.reach(pose_of(self.point)))

    def do_times(self, by: Six) -> None:
        self.change = times(self.change, pose_of(by))

    def do_invert(self) -> None:
        self.change = inverse(self.change)

    def do_approach(self, to: tuple[Op, Op, Op]) -> None:
        self.ends.append(self.reach(times(self.take(to), self.change)))

    def do_composed(self, by: Six, to: tuple[Op, Op, Op]) -> None:
        place = times(self.frame(), self.take(to))
        self.ends.append((times(self.within, pose_of(by), inverse(self.within), place), self.speed))


class Val3Text(Text):
    """The program as lines."""

    equal, unequal = "==", "!="

    def name(self, of: str) -> str:
        return f"n{super().name(of).upper()}"

    @staticmethod
    def six(values: Six) -> str:
        return "{" + ",".join(str(value) for value in values) + "}"

    def put(self, to: tuple[Op, ...]) -> str:
        return f"pG.trsf={{{','.join(self.value(one) for one in to)},nRx,nRy,nRz}}"

    def do_move(self, *to: Op) -> Iterator[str]:
        yield from [self.put(to), "movel(pG,tMill,mRun)"]

    def do_set(self, target: str, to: Op) -> Iterator[str]:
        yield f"{self.name(target)}={self.value(to)}"

    def do_add(self, target: str, by: Op) -> Iterator[str]:
        yield f"{self.name(target)}={self.name(target)}+{self.value(by)}"

    def do_lean(self, angles: tuple[int, int, int]) -> Iterator[str]:
        for letter, value in zip("xyz", angles, strict=True):
            yield f"nR{letter}={value}"

    def do_speed(self, speed: int) -> Iterator[str]:
        yield f"mRun.tvel={speed}"

    def do_link(self, father: str) -> Iterator[str]:
        yield f"link(pG,{father})"

    def do_frame(self, values: Six) -> Iterator[str]:
        yield f"fB.trsf={self.six(values)}"

    def do_set_frame(self, p: tuple[int, int, int]) -> Iterator[str]:
        for k, by in enumerate(THREE):
            yield f"q[{k}].trsf={self.six((*(a + b for a, b in zip(p, by, strict=True)), 0, 0, 0))}"  # type: ignore[arg-type]
        yield "nDone=setFrame(q[0],q[1],q[2],fB)"

    def do_component(self, axis: int, value: Op) -> Iterator[str]:
        yield from [f"pG.trsf.{'xyz'[axis]}={self.value(value)}", "movel(pG,tMill,mRun)"]

    def do_times(self, by: Six) -> Iterator[str]:
        yield f"tr=tr*{self.six(by)}"

    def do_invert(self) -> Iterator[str]:
        yield "tr=!tr"

    def do_approach(self, to: tuple[Op, Op, Op]) -> Iterator[str]:
        yield from [self.put(to), "movel(appro(pG,tr),tMill,mRun)"]

    def do_composed(self, by: Six, to: tuple[Op, Op, Op]) -> Iterator[str]:
        yield from [self.put(to), f"movel(compose(pG,fB,{self.six(by)}),tMill,mRun)"]

    def do_if(self, test: Op, then: list[Op], other: list[Op]) -> Iterator[str]:
        yield f"if ({self.condition(test)})"
        yield from [*self.lines(then), "else", *self.lines(other), "endIf"]

    def do_case(self, of: str, values: list[int], *bodies: list[Op]) -> Iterator[str]:
        yield f"switch {self.name(of)}"
        for word, body in zip((f"case {NEVER},{values[0]}", f"case {values[1]}", "default"), bodies, strict=True):
            yield from [word, *self.lines(body), "break"]
        yield "endSwitch"

    def do_for(self, first: int, last: int, step: int, body: list[Op]) -> Iterator[str]:
        yield f"for nI{self.depth + 1}={first} to {last} step {step}"
        yield from [*self.inside(body), "endFor"]

    def do_loop(self, times: int, body: list[Op]) -> Iterator[str]:
        counter = f"nI{self.depth + 1}"
        inside = [f"{counter}={counter}+1", *self.inside(body)]
        yield f"{counter}=0"
        if times == 3:
            yield from ["do", *inside, f"until ({counter}>=3)"]
        else:
            yield from [f"while ({counter}<{times})", *inside, "endWhile"]

    def do_call(self, target: str, given: Op) -> Iterator[str]:
        yield f"call cut({self.name(target)},{self.value(given)})"


def sub(name: str, parameters: dict[str, str], *lines: str) -> str:
    """A program with parameters and a local variable."""
    head = '<Parameters xmlns="x">\n'
    for parameter, use in parameters.items():
        head += f'<Parameter name="{parameter}" type="num" use="{use}" xsi:type="element"/>\n'
    head += '</Parameters>\n<Locals>\n<Local name="l_nK" type="num" xsi:type="array" size="1"/>\n</Locals>\n'
    return program(*lines).replace('name="part"', f'name="{name}"').replace("<Code>", f"{head}<Code>")


@pytest.fixture(scope="module")
def called(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs that are called: each has a local variable that begins anew, and uses its parameters behind a call."""
    folder = tmp_path_factory.mktemp("called")
    texts = {
        "cut": sub(
            "cut", {"x_nX": "reference", "x_nY": "value"}, "x_nY=x_nY+1", "call inner(x_nY)", "l_nK=l_nK+x_nY",
            "pG.trsf={x_nX,x_nY,1,nRx,nRy,nRz}", "movel(pG,tMill,mRun)", "x_nX=x_nX-l_nK",
        ),
        "inner": sub(
            "inner", {"x_nY": "value"}, "l_nK=l_nK+2*x_nY", "x_nY=0", "pG.trsf={l_nK,l_nK,2,nRx,nRy,nRz}",
            "movel(pG,tMill,mRun)",
        ),
    }  # fmt: skip
    for name, text in texts.items():
        (folder / f"{name}.pgx").write_text(text)
    return folder


def variables() -> str:
    """The data file."""
    numbers = {f"n{n.upper()}": value for n, value in Counting().at.items()}
    numbers |= dict.fromkeys(("nI1", "nI2", "nI3", "nDone", "nRx", "nRz"), 0) | {"nRy": 180}
    more = "".join(
        f'    <Data name="{n}" type="num" size="1"><Value key="0" value="{value}"/></Data>\n'
        for n, value in numbers.items()
    )
    attributes = " ".join(f'{key}="{v}"' for key, v in zip(("x", "y", "z", "rx", "ry", "rz"), WITHIN, strict=True))
    more += f'    <Data name="fB" type="frame" size="1"><Value key="0" {attributes} fatherId="fPart[0]"/></Data>\n'
    for name, size in (("pG", 1), ("q", 3)):
        rows = "".join(f'<Value key="{k}" {at(0, 0, 0)}/>' for k in range(size))
        more += f'    <Data name="{name}" type="pointRx" size="{size}">{rows}</Data>\n'
    more += '    <Data name="tr" type="trsf" size="1"><Value key="0" z="0"/></Data>\n  </Datas>'
    return data([at(0, 0, 0)]).replace("  </Datas>", more)


PROGRAMS = programs(
    st.tuples(st.just("lean"), turn), st.tuples(st.just("speed"), st.integers(1, 900)),
    st.tuples(st.just("link"), st.sampled_from(["fB", "world", "fPart"])), st.tuples(st.just("frame"), six),
    st.tuples(st.just("set_frame"), st.tuples(small, small, small)),
    st.tuples(st.just("component"), st.integers(0, 2), leaf), st.tuples(st.just("times"), six),
    st.tuples(st.just("invert")), st.tuples(st.just("approach"), goal), st.tuples(st.just("composed"), six, goal),
)  # fmt: skip


@RANDOM_PROGRAMS
@given(PROGRAMS)
def test_a_program_makes_the_motions_of_the_reference(called: Path, ops: list[Op]) -> None:
    """Places, orientations and speeds of every motion, in whatever frame the point was linked to before it."""
    ops = [*ops, *(("move", ("v", n), ("n", 0), ("n", 7)) for n in NAMES)]
    reference = Val3()
    reference.run(ops)
    assume(reference.is_small())
    text = program("movej(p[0],tMill,mRun)", *Val3Text().lines(ops))
    made = read_val3(text, name="part.pgx", data=variables(), data_name="part.dtx", folder=Val3Folder(called))
    assert made.Rs_part_tcp is not None
    assert len(made.motions) == len(reference.ends) + 1
    for motion, R, ((turned, p), speed) in zip(made.motions[1:], made.Rs_part_tcp[1:], reference.ends, strict=True):
        np.testing.assert_allclose(np.asarray(motion.p_end) / MM, p, atol=1e-6)
        np.testing.assert_allclose(R, turned.as_matrix(), atol=1e-9)
        assert motion.feed_m_s / MM == pytest.approx(speed, rel=1e-9)
