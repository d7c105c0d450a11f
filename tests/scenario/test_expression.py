"""The language of scenario files: what it works out, and what it does not let in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from sumo_eval.scenario.expression import DEEPEST, Expression, checked_names, condition, number

real = st.floats(-50, 50).map(lambda value: round(value, 3))


@given(real, real, st.floats(0.1, 50))
def test_law_arithmetic_is_that_of_numbers(a, b, c):
    values = {"a": a, "b": b, "c": c}
    assert Expression("a + 2 * b - a * b / c").value(values) == pytest.approx(a + 2 * b - a * b / c)
    # the power binds closer than the sign
    assert Expression("-a ** 2").value(values) == pytest.approx(-(a**2))
    assert Expression("max(a, b, 0) + abs(min(a, b)) + sqrt(c)").value(values) == pytest.approx(
        max(a, b, 0) + abs(min(a, b)) + c**0.5
    )
    assert bool(Expression("a < b <= c or not a < c").value(values)) == ((a < b <= c) or not a < c)


def test_one_expression_serves_a_point_and_a_whole_space():
    rule = Expression("where(speed > 10, speed - 10, 0)")
    assert rule.value({"speed": np.array([5.0, 10.0, 12.5])}).tolist() == [0.0, 0.0, 2.5]
    assert float(rule.value({"speed": 12.5})) == 2.5


EXACT = (
    "a + 2 * b - a * b / c", "1 / (a - b)", "a / 0", "-a / 0", "min(a, b, 0.5) - max(c, "
                                                               "-a)", "abs(b) * -a", "sqrt(a)",
    "+a - (3 - 1)",
    "where(a < b <= c or not a < 0, a / c, b)", "where(a == b and b != c, 1, where(c >= a and a > "
                                                "b, 2, 3))",
)  # fmt: skip
ROUNDED = ("a ** 2 - c ** b", "exp(a) + log(b)", "tanh(a / c)")


@given(st.lists(st.tuples(real, real, real), min_size=1, max_size=8))
def test_law_a_point_alone_has_the_number_that_it_has_in_a_space(rows):
    space = {
        name: np.array(column) for name, column in zip("abc", zip(*rows, strict=True), strict=True)
    }
    points = [dict(zip("abc", row, strict=True)) for row in rows]
    for text in EXACT:
        alone = np.array([Expression(text).at(point) for point in points])
        together = np.broadcast_to(Expression(text).value(space), len(rows))
        numbers = ~np.isnan(alone)  # a nan has bits that mean nothing
        assert np.array_equal(numbers, ~np.isnan(together))
        assert alone[numbers].tobytes() == together[numbers].tobytes()
    for text in ROUNDED:
        alone = [Expression(text).at(point) for point in points]
        np.testing.assert_allclose(alone, Expression(text).value(space), rtol=1e-14)


@pytest.mark.parametrize("name", ["min", "max"])
def test_what_is_not_a_number_stays_so_on_both_sides(name):
    for values in ({"a": np.nan, "b": 1.0}, {"a": 1.0, "b": np.nan}):
        rule = Expression(f"{name}(a, b)")
        assert np.isnan(rule.at(values))
        assert np.isnan(rule.value(values))


def test_a_missing_value_is_named():
    for ask in (Expression("2 * ego_speed").at, Expression("2 * ego_speed").value):
        with refusal("Did you mean `ego_sped`"):
            ask({"ego_sped": 1.0})


def test_it_knows_the_names_it_needs_and_whether_it_is_a_condition():
    assert Expression("min(a, 3 * b)").names == {"a", "b"}
    assert condition("a < b and not b < 2", "a test")
    assert number("where(a < b, a, b)", "a test")


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')", "speed.real", "speed[0]", "[1, 2]", "lambda: 1",
        "(a := 1)", "f'{a}'", "'text'",
        "a if a < b else b", "a @ b", "a // b", "a & b", "~a", "a in b", "a is b", "min(*a)",
        "min(a, key=b)", "True", "None",
        "1j", "1e999", "{a}", "a; b", "a = 1", "", "  ",
        "(" * 60 + "a" + ")" * 60 + "+" * 70 + "a", "exec(a)", "abs(a, b)",
        "min(a)", "a and b", "(a < b) + 1", "where(a, b, b)", "not a", "x" * 1001, "-" * 900 + "a",
    ],
)  # fmt: skip
def test_nothing_else_is_let_in(text):
    with refusal():
        Expression(text)


def test_a_misspelt_name_or_function_is_answered_with_the_nearest():
    with refusal("Did you mean `ego_speed`"):
        checked_names(Expression("2 * ego_sped"), ["ego_speed", "gap"], "a test")
    with refusal("Did you mean `sqrt`"):
        Expression("sqr(a)")


def test_a_number_is_not_a_condition_nor_the_reverse():
    with refusal("a number, not a comparison"):
        number("a < 3", "a test")
    with refusal("a condition such as"):
        condition("a + 3", "a test")
    assert float(number(3, "a test").value({})) == 3.0


def test_what_is_not_defined_is_not_finite_and_gives_no_warning():
    assert not np.isfinite(Expression("1 / a").value({"a": 0.0}))


def test_names_may_be_nested_as_deep_as_numbers():
    assert Expression(DEEPEST * "-" + "a").at({"a": 2.0}) == 2.0
    with refusal("nested more than 50 deep"):
        Expression(DEEPEST * "-" + "-a")


@pytest.mark.parametrize("text", ["abs(abs)", "min", "x + min", "where(x < 1, min, 2)", "x < abs"])
def test_a_function_without_its_values_is_refused(text):
    with refusal("is a function: it must be given values in brackets"):
        Expression(text)


@pytest.mark.parametrize("text", ["9" * 990, "1e999", "0x" + "f" * 900, "x + " + "1" * 400])
def test_a_number_that_no_float_can_hold_is_refused(text):
    with refusal("must hold finite numbers and names only"):
        Expression(text)
    with refusal("must be finite"):
        number(10**400, "the test")
    with refusal("In gap of my.toml: Expression"):
        number(text, "gap of my.toml")


@pytest.mark.parametrize(
    "text", ["\ud800", "x\x00", "-" * 900 + "x", "(" * 400 + "x" + ")" * 400, "1" * 5_000, "f'{x}'"]
)
def test_odd_text_gives_a_message_that_can_be_shown(text):
    with refusal() as caught:
        Expression(text)
    str(caught.value).encode("utf-8")


@pytest.mark.parametrize(
    "rule",
    [
        "a < b", "a <= b", "a > b", "a >= b", "a == b", "a != b", "not a < b", "a < b <= c",
        "a < b and b < c",
        "a < b or c < a", "not (a == b or b > c)",
    ],
)  # fmt: skip
def test_law_a_condition_has_room_where_it_holds_and_none_where_it_does_not(rule):
    values = dict(
        zip("abc", np.random.default_rng(1).integers(-2, 3, (3, 200)).astype(float), strict=True)
    )
    expression = Expression(rule)
    holds, room = expression.value(values), expression.room(values)
    assert np.all(holds[room > 0.0])
    assert not np.any(holds[room < 0.0])
    assert np.any(room)
