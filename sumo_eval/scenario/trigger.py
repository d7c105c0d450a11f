"""Conditions at which moves begin, such as `ttc(ego, child) < 2 and y(child) > 1`, translated to
the operations that the kernel `played.holds_from` evaluates in each step while the move waits.

A condition may have numbers of the point and numbers of the moment. Numbers of the point
(parameters, definitions, options) are evaluated once for a case. Numbers of the moment are `time`,
s since the start; `departed`, m between the ego and the recorded ego at that time; and the
functions in `FUNCTIONS`.

Users: `scenario/vehicle_tables.py`, for the key `when` of a manoeuvre;
`extras/openscenario/written.py`. Fixed: names, which are a public format; the order of operations,
which is part of a drive's fingerprint.
"""

import ast

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario import played
from sumo_eval.scenario.expression import (
    MATH_FUNCTIONS,
    checked_names,
    number,
    operation,
    parsed,
)
from sumo_eval.scenario.formulas import NOT_NAN, LimitedFormula, Names

OF_ONE = {"x": played.X, "y": played.Y, "speed": played.ALONG, "lateral_speed": played.ACROSS}
"""Functions of one vehicle: name in a condition -> operation of `played`."""
OF_TWO = {"gap": played.GAP, "distance": played.DISTANCE, "ttc": played.TTC, "thw": played.THW}
"""Functions of two vehicles."""
FUNCTIONS = {
    "x": "x(a): its centre along the road, m",
    "y": "y(a): its centre across the road, m",
    "speed": "speed(a): along the road, m/s",
    "lateral_speed": "lateral_speed(a): across the road, m/s, to the left",
    "gap": "gap(a, b): along the road from a's front to b's rear, m; negative once a is beside or "
    "past b",
    "distance": "distance(a, b): between the centres, m",
    "ttc": "ttc(a, b): gap over closing speed, s; inf where they do not close, and once a is "
    "beside or past b",
    "thw": "thw(a, b): gap over a's speed, s; inf where a does not move forward, and once it is "
    "beside or past b",
    "ended": "ended(a, m): whether a's manoeuvre of the name m is over",
}
"""Meaning of each function of vehicles; `ego` is the name of the ego."""
# Operations of the language -> operations of `played`. `expression.operation` names operators by
# their class in `ast`, functions with `()`. `>` has the operation of `<`: its operands are swapped.
_OF_NUMBERS = {
    "Add": played.ADD, "Sub": played.SUBTRACT, "Mult": played.MULTIPLY, "Div": played.DIVIDE,
    "USub": played.NEGATE, "min()": played.SMALLER, "max()": played.LARGER,
    "abs()": played.ABSOLUTE,
}  # fmt: skip
_OF_CONDITIONS = {
    "And": played.AND, "Or": played.OR, "Lt": played.BELOW, "Gt": played.BELOW,
    "LtE": played.AT_MOST, "GtE": played.AT_MOST,
}  # fmt: skip
_NUMBERS = "of numbers, names, + - * /, min, max, abs, `time` and " + ", ".join(FUNCTIONS)
EGO_NAME = "ego"

Step = tuple[int, int, int, LimitedFormula | None]
"""An operation of `Act.program`: (op, vehicle, vehicle or move, formula). The formula gives the
constant of a `played.VALUE` at each point; of every other operation it is None."""


def trigger(text: str, owner: str, names: Names, *, may_use_departed: bool) -> list[Step]:
    """The steps of the condition in a text.

    owner: the manoeuvre, for messages.
    names: that the condition may use; the numbers of the point in it are added to `names.scene`.
    may_use_departed: whether the condition may contain `departed`.
    Raises InputError naming what is wrong, and the nearest word.
    """
    tree = parsed(text, f"Condition `{text[:200]}` of {owner}")
    steps = _Writer(text, owner, names, may_use_departed).steps(tree, condition=True)
    # a bound on the work: while the move waits, each step of a drive executes all of them
    if len(steps) > 4 * played.DEEPEST:
        raise InputError(f"Condition `{text[:200]}` of {owner} is too long.")
    return steps


@frozen
class _Writer:
    """Writes the steps of one condition; arguments as in `trigger`."""

    text: str
    owner: str
    names: Names
    may_use_departed: bool

    def steps(self, node: ast.expr, *, condition: bool, depth: int = 0) -> list[Step]:
        """Steps that leave one value on the stack: whether a condition holds, or a number.

        condition: whether the node must be a condition.
        depth: number of operations around the node. Its value has at most this many values below it
            on the stack: one of each operation whose first operand is already computed.
        """
        # 2: an operation of one value reads the row above it, too (`played._operate`)
        if depth >= played.DEEPEST - 2:
            raise InputError(f"Condition {self._place} is nested too deep.")
        if not condition and not self._of_the_moment(node):
            return [self._constant(node)]
        if isinstance(node, ast.Name) and not condition:
            return [self._now(node.id)]

        name, parts = operation(node)
        op = (_OF_CONDITIONS if condition else _OF_NUMBERS).get(name)
        if op is None:
            return [self._of_vehicles(node, name.removesuffix("()"), parts, condition=condition)]
        if name == "abs()" and len(parts) != 1:
            raise self._wrong(node, "given one value")
        if name in ("min()", "max()") and len(parts) < 2:
            raise self._wrong(node, "given at least 2 values")
        if name in ("Gt", "GtE"):  # `a > b` is written as `b < a`
            parts = parts[::-1]
        of_conditions = name in ("And", "Or")
        steps, *further = [self.steps(it, condition=of_conditions, depth=depth + 1) for it in parts]
        # operands come before their operation: a, op; a, b, op; a, b, op, c, op
        step: Step = (op, 0, 0, None)
        if not further:
            return [*steps, step]
        for operand in further:
            steps += [*operand, step]
        return steps

    def _constant(self, node: ast.expr) -> Step:
        """Step of a number of the point."""
        # `time` is known too, so that the error of a misspelt name can propose it
        known = [*self.names.known, "time"]
        constant = checked_names(number(ast.unparse(node), self._place), known, self._place)
        self.names.scene.append(constant)
        # every comparison with nan is false: a condition with it would silently lose a part
        what = f"A number in the condition {self._place}"
        return played.VALUE, 0, 0, LimitedFormula(what, self.names.owner, constant, NOT_NAN)

    def _now(self, name: str) -> Step:
        """Step of `time` or `departed`."""
        if name == "time":
            return played.TIME, 0, 0, None
        if self.may_use_departed:
            return played.DEPARTED, 0, 0, None
        raise InputError(
            f"`departed` in the condition {self._place} is allowed only in the `when` of a "
            "`follow`, where [ego] has `recorded` places."
        )

    def _of_vehicles(
        self, node: ast.expr, name: str, args: list[ast.expr], *, condition: bool
    ) -> Step:
        """Step of a function of vehicles."""
        words = [arg.id for arg in args if isinstance(arg, ast.Name)]
        if len(words) < len(args):  # an argument that is not a name is wrong: no case fits
            words = []
        match words:
            case [vehicle, move] if condition and name == "ended":
                return self._ended(node, vehicle, move)
            case [vehicle] if not condition and name in OF_ONE:
                return OF_ONE[name], self._vehicle(vehicle), 0, None
            case [one, two] if not condition and name in OF_TWO:
                if one == two:
                    raise self._wrong(node, "of two vehicles")
                return OF_TWO[name], self._vehicle(one), self._vehicle(two), None
        raise self._misplaced(node, name, condition=condition)

    def _ended(self, node: ast.expr, vehicle: str, move: str) -> Step:
        """Step of `ended(vehicle, move)`."""
        number_of_vehicle = self._vehicle(vehicle)
        if number_of_vehicle == played.EGO:
            raise self._wrong(node, "of a vehicle with manoeuvres: the ego has none")
        moves = self.names.vehicles[vehicle]
        check_known(f"manoeuvre of vehicle `{vehicle}` in {self._place}:", moves, move)
        return played.ENDED, number_of_vehicle, moves[move], None

    def _misplaced(self, node: ast.expr, name: str, *, condition: bool) -> InputError:
        """The error of a node that should be a function of vehicles: says what must stand there."""
        if condition and isinstance(node, ast.Compare):
            return self._wrong(node, "compared with <, <=, > or >=")
        if condition:
            wanted = "a condition such as `ttc(ego, child) < 2`, alone or joined by `and`, `or`"
            return self._wrong(node, wanted)
        if name and isinstance(node, ast.Call):
            # raises InputError for an unknown function
            check_known(f"function in {self._place}:", [*FUNCTIONS, "min", "max", "abs"], name)
        return self._wrong(node, f"as in {FUNCTIONS[name]}" if name in FUNCTIONS else _NUMBERS)

    @property
    def _place(self) -> str:
        """Name of the condition in error messages."""
        return f"`{self.text[:200]}` of {self.owner}"

    def _of_the_moment(self, node: ast.expr) -> bool:
        """Whether a node holds `time`, `departed` or a function of vehicles."""
        # a parameter may have one of these names, and hides it
        moment = {"time", "departed"}.difference(self.names.known)
        for part in ast.walk(node):
            if isinstance(part, ast.Name) and part.id in moment:
                return True
            if isinstance(part, ast.Call):
                name, _ = operation(part)
                if name.removesuffix("()") not in MATH_FUNCTIONS:
                    return True
        return False

    def _vehicle(self, name: str) -> int:
        """Number of a vehicle among the actors by its name, or `played.EGO`."""
        if name == EGO_NAME:
            return played.EGO
        check_known(f"vehicle in {self._place}:", [EGO_NAME, *self.names.vehicles], name)
        return list(self.names.vehicles).index(name)

    def _wrong(self, node: ast.expr, wanted: str) -> InputError:
        """The error of a node that must be as `wanted` says."""
        return must_be(
            f"`{ast.unparse(node)}` in the condition", self.owner, wanted, self.text[:200]
        )
