"""Random programs that count, branch, loop and call, and what they do: a judge of the evaluators of robot languages.

A program is a list of operations, each a tuple of a word and its arguments. Languages add words of their own. Every
number is whole, so that a wrong step shows exactly.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import Any, Final

from hypothesis import HealthCheck, Phase, settings, strategies as st
from hypothesis.strategies import SearchStrategy

Op = tuple[Any, ...]
RANDOM_PROGRAMS: Final = settings(
    max_examples=120,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)
"""The smallest program that fails would take minutes to find."""
NAMES: Final = ("a", "b", "c")
COMPARED: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq, "<>": operator.ne,
}  # fmt: skip
_COMPUTED: Final[dict[str, Callable[[Any, Any], Any]]] = {"+": operator.add, "-": operator.sub, "*": operator.mul}
LARGEST: Final = 10**6
"""Numbers beyond it are no places that a robot reaches, and such programs are left out."""
NEVER: Final = 3 * LARGEST
"""A number that nothing becomes."""
MOST: Final = 120
"""Motions of a program, at most."""

name: SearchStrategy[str] = st.sampled_from(NAMES)
small: SearchStrategy[int] = st.integers(-9, 9)
leaf: SearchStrategy[Op] = st.one_of(
    st.tuples(st.just("n"), small), st.tuples(st.just("v"), st.sampled_from((*NAMES, "i")))
)
expression: SearchStrategy[Op] = st.one_of(leaf, st.tuples(st.sampled_from("+-*"), leaf, leaf))
condition: SearchStrategy[Op] = st.tuples(st.sampled_from(list(COMPARED)), leaf, leaf)
move: SearchStrategy[Op] = st.tuples(st.just("move"), leaf, leaf, leaf)


def programs(*more: SearchStrategy[Op], steps: tuple[int, ...] = (1, -1, 2, -2)) -> SearchStrategy[list[Op]]:
    """Programs of the common words and those of a language.

    Args:
        more: Words of the language.
        steps: Of its counted loops.
    """
    simple = st.one_of(
        move, move, st.tuples(st.just("set"), name, expression), st.tuples(st.just("add"), name, leaf),
        st.tuples(st.just("call"), name, leaf), *more,
    )  # fmt: skip

    def nested(inner: SearchStrategy[Op]) -> SearchStrategy[Op]:
        body = st.lists(inner, min_size=1, max_size=3)
        return st.one_of(
            st.tuples(st.just("if"), condition, body, body),
            st.tuples(st.just("for"), st.integers(-2, 3), st.integers(-2, 3), st.sampled_from(steps), body),
            st.tuples(st.just("loop"), st.integers(0, 3), body),
            st.tuples(st.just("case"), name, st.lists(st.integers(-2, 3), min_size=2, max_size=2, unique=True), body,
                      body, body),
        )  # fmt: skip

    return st.lists(st.one_of(simple, nested(st.one_of(simple, nested(simple)))), min_size=3, max_size=10)


class Counting:
    """State of a program that counts.

    Attributes:
        at: Numbers by name; ``i1`` is the counter of the outermost loop.
        ends: What :meth:`placed` says of each motion.
        depth: Loops that run.
    """

    def __init__(self) -> None:
        self.at: dict[str, int] = {"a": 1, "b": 2, "c": 3}
        self.ends: list[Any] = []
        self.depth = 0

    def value(self, node: Op) -> int:
        """Value of an expression; ``i`` is the counter of the innermost loop, outside of loops ``a``."""
        word, *rest = node
        if word == "n":
            return int(rest[0])
        if word == "v":
            return self.at[(f"i{self.depth}" if self.depth else "a") if rest[0] == "i" else rest[0]]
        return self.computed(word, *(self.value(one) for one in rest))

    def computed(self, word: str, one: int, two: int) -> int:
        """Value of an operator."""
        return int(_COMPUTED[word](one, two))

    def run(self, ops: list[Op]) -> None:
        """Do operations in their order."""
        for word, *rest in ops:
            getattr(self, f"do_{word}")(*rest)

    def is_small(self) -> bool:
        """Whether the program stays within what a robot reaches and a test has time for."""
        numbers = [abs(value) for value in self.at.values()]
        return max(numbers) < LARGEST and len(self.ends) < MOST

    def placed(self, x: int, y: int, z: int) -> Any:
        """Return what is known of a motion to a place."""
        return (x, y, z)

    def go(self, x: int, y: int, z: int) -> None:
        """Note a motion; a number that is too large stays, so that the program is left out."""
        if max(abs(x), abs(y), abs(z)) >= LARGEST:
            self.at["a"] = 2 * LARGEST
        self.ends.append(self.placed(x, y, z))

    def do_move(self, x: Op, y: Op, z: Op) -> None:
        self.go(self.value(x), self.value(y), self.value(z))

    def do_set(self, target: str, to: Op) -> None:
        self.at[target] = max(-2 * LARGEST, min(2 * LARGEST, self.value(to)))

    def do_add(self, target: str, by: Op) -> None:
        self.do_set(target, ("+", ("v", target), by))

    def do_if(self, test: Op, then: list[Op], other: list[Op]) -> None:
        word, one, two = test
        self.run(then if COMPARED[word](self.value(one), self.value(two)) else other)

    def do_case(self, of: str, values: list[int], first: list[Op], second: list[Op], other: list[Op]) -> None:
        chosen = dict(zip(values, (first, second), strict=True)).get(self.at[of], other)
        self.run(chosen)

    def do_for(self, first: int, last: int, step: int, body: list[Op]) -> None:
        self.depth += 1
        for count in range(first, last + (1 if step > 0 else -1), step):
            self.at[f"i{self.depth}"] = count
            self.run(body)
        self.depth -= 1

    def do_loop(self, times: int, body: list[Op]) -> None:
        self.depth += 1
        for count in range(1, times + 1):
            self.at[f"i{self.depth}"] = count
            self.run(body)
        self.depth -= 1

    def do_call(self, target: str, given: Op) -> None:
        """A routine with a number by reference and one by value, which calls another one and then uses both."""
        y = self.value(given) + 1
        self.go(2 * y, 2 * y, 2)
        self.go(self.at[target], y, 1)
        self.at[target] -= y


class Text:
    """Writes operations in a language, one method for each word.

    Attributes:
        depth: Loops around the operation.
        equal, unequal: Comparisons as the language spells them.
    """

    equal, unequal = "=", "<>"

    def __init__(self) -> None:
        self.depth = 0

    def name(self, of: str) -> str:
        """Name of a number; ``i`` is the counter of the innermost loop."""
        return (f"i{self.depth}" if self.depth else "a") if of == "i" else of

    def value(self, node: Op) -> str:
        """Text of an expression."""
        word, *rest = node
        if word == "n":
            return f"({rest[0]})" if rest[0] < 0 else str(rest[0])
        if word == "v":
            return self.name(rest[0])
        return f"({self.value(rest[0])}{word}{self.value(rest[1])})"

    def condition(self, test: Op) -> str:
        """Text of a comparison."""
        word, one, two = test
        word = {"=": self.equal, "<>": self.unequal}.get(word, word)
        return f"{self.value(one)}{word}{self.value(two)}"

    def lines(self, ops: list[Op]) -> Iterator[str]:
        """Lines of operations."""
        for word, *rest in ops:
            yield from getattr(self, f"do_{word}")(*rest)

    def inside(self, body: list[Op]) -> list[str]:
        """Lines of the body of a loop."""
        self.depth += 1
        out = list(self.lines(body))
        self.depth -= 1
        return out
