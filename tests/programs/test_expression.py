"""Expressions of program languages against Python's own arithmetic."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.programs.expression import ExpressionError, Grammar, evaluate, parse, parse_whole
from counterflex.programs.unknown import Unknown, known

GRAMMAR = Grammar(
    binary={
        "OR": (1, lambda a, b: a or b), "AND": (2, lambda a, b: a and b), "=": (3, operator.eq), "<>": (3, operator.ne),
        "<": (3, lambda a, b: a < b), "+": (4, operator.add), "-": (4, operator.sub), "*": (5, operator.mul),
        "/": (5, operator.truediv),
    },
    unary={"NOT": (3, lambda a: not a), "-": (6, lambda a: -a), "+": (6, lambda a: a)},
    constants={"TRUE": True, "FALSE": False},
)  # fmt: skip
KRL = Grammar(
    binary={":": (7, lambda a, b: ("composed", a, b)), "+": (4, operator.add)}, unary={"-": (6, lambda a: -a)},
    name=r"[A-Za-z_$]\w*", aggregate="{}", labelled=True, enumeration=r"#\w+",
)  # fmt: skip


class Names:
    """Names with values; the unknown one is entered by a person."""

    values: Mapping[str, object] = {"n": Unknown("a person enters it", "a.mod:4"), "a": [1, [2, 3]], "p": {"X": 7.0}}

    def value_of(self, name: str, path: Sequence[object]) -> object:
        value = self.values[name]
        for step in path:
            value = value[step] if isinstance(step, str) else value[step[0]]  # type: ignore[index]
        return value

    def call(self, name: str, arguments: Sequence[object], options: Mapping[str, object]) -> object:
        return (name, list(arguments), dict(options))


def value(text: str, grammar: Grammar = GRAMMAR) -> object:
    return evaluate(parse_whole(text, grammar), grammar, Names())


numbers = st.integers(0, 99).map(str) | st.floats(0.01, 99.0).map(lambda x: f"{x:.3f}")
terms = st.recursive(
    numbers,
    lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(" ".join) | inner.map(lambda x: f"(-{x})"),
    max_leaves=12,
)


@given(terms)
def test_arithmetic_is_that_of_python(text: str) -> None:
    assert value(text) == eval(text)  # numbers and operators alone


@given(
    st.lists(st.booleans(), min_size=2, max_size=5), st.lists(st.sampled_from(["AND", "OR"]), min_size=4, max_size=4)
)
def test_logic_is_that_of_python(truths: list[bool], words: list[str]) -> None:
    text = str(truths[0])
    for truth, word in zip(truths[1:], words, strict=False):
        text += f" {word} {truth}"
    assert value(text.upper()) is eval(text.replace("AND", "and").replace("OR", "or"))


def test_unknown_values_spread_and_are_refused_where_they_are_used() -> None:
    result = value("2 * n + 1")
    assert isinstance(result, Unknown)
    assert value("n < 2 AND FALSE") is False
    with pytest.raises(ProgramError, match=r"a person enters it in a\.mod:4") as error:
        known([1.0, {"x": result}], "the target", "a.mod:9:3", text="MoveL p")
    assert "a.mod:9:3" in str(error.value)


def test_paths_calls_options_and_aggregates() -> None:
    assert value("a[1]") == [2, 3]
    assert value("p.X + 1") == 8.0
    assert value(r"Offs(p, 1, -2 \Tool:=a \Off)") == ("Offs", [{"X": 7.0}, 1, -2], {"TOOL": [1, [2, 3]], "OFF": None})
    assert value("[1, [2, TRUE]]") == [1, [2, True]]
    assert value("{E6POS: X 1, Y -2.5}", KRL) == {"X": 1, "Y": -2.5}
    assert value("{X 1} : {B p.X}", KRL) == ("composed", {"X": 1}, {"B": 7.0})
    assert value("#base", KRL) == "#BASE"


@pytest.mark.parametrize("text", ["", "1 +", "(1", "1 2", "[1 2]", "f(1", "1 / 0", '"a" - 1', "a["])
def test_what_is_no_expression_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        value(text)


def test_an_expression_ends_where_the_text_goes_on() -> None:
    node, end = parse("1+2 THEN x", GRAMMAR)
    assert (evaluate(node, GRAMMAR, Names()), end) == (3, 3)
