"""Severity of a contact: the number V that replaces U of Eq. 15 in Eq. 17 and in the avoided share
A.

`scoring/` computes V of each contact. The setting `method.collision.severity` chooses it:

- `severity`: U of Eq. 15, m/s, as the paper prints it;
- `eq14`: U as well; the scores are then computed from its class L of Eq. 14;
- `injury:car_driver`, `injury:pedestrian`, `injury:cyclist`: the probability that a contact with
  the front of a car injures this person seriously or fatally (MAIS3+ or death), by closing speed
  and the person's age (Lubbe, Wu, Jeppsson 2022);
- `package.module:function` or `file.py:function`: a user's function of one `Contact` that returns a
  loss within 0..1.

V_g of the ideal vehicle's contact replaces Ug_i, and V_0 of the contact of `no_reaction` replaces
U0_i. Without a contact V is 0, and L of Eq. 14 is 0.1. So

    C = sum(r V_g / V) / sum(r)
    A = 1 - sum(w max(0, V - V_g)) / sum(w max(0, V_0 - V_g))

Users: `cli/tools.py`, `evaluation.py`, `record/facts.py`, `record/trust.py`,
`scoring/quantities.py`, `scoring/space.py`, `scoring/steps.py`. Fixed: fields of `Contact`, which
users' functions read, and the names of the severities. Free to change: messages.
"""

import hashlib
import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, check_known, must_be, unknown, users_code
from sumo_eval.method.checks import not_negative
from sumo_eval.method.collision_avoidance import impact_severity
from sumo_eval.settings import CollisionSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.text import shown
from sumo_eval.trajectory import Collision, FloatArray, Side

KMH = 3.6
"""Factor from m/s to km/h."""


class Contact(NamedTuple):
    """First contact of a case, which a user's severity function receives; vectors are in the ego's
    frame, x ahead and y to its left.

    ego_velocity, other_velocity: m/s.
    ego_mass, other_mass: kg (`method.collision`).
    overlap: share of the ego's bumper width that faces the other vehicle, 0..1.
    side: side of the ego that was hit.
    angle: heading of the other vehicle less that of the ego, rad within -pi..pi; 0 for a rear-end
        contact in line.
    other: name of the other vehicle in the scenario.
    """

    ego_velocity: tuple[float, float]
    other_velocity: tuple[float, float]
    ego_mass: float
    other_mass: float
    overlap: float
    side: Side
    angle: float
    other: str

    @property
    def closing_speed(self) -> float:
        """|v_ego - v_other|, m/s."""
        return math.dist(self.ego_velocity, self.other_velocity)


def contact_of(collision: Collision, settings: CollisionSettings) -> Contact:
    """The contact of a recorded collision.

    settings: `[method.collision]`: masses, kg.
    """
    heading = collision.ego_pose[2]  # a pose is x, y, heading
    cosine = math.cos(heading)
    sine = math.sin(heading)

    def in_ego_frame(velocity: tuple[float, float]) -> tuple[float, float]:
        vx, vy = velocity
        return cosine * vx + sine * vy, cosine * vy - sine * vx

    return Contact(
        ego_velocity=in_ego_frame(collision.ego_velocity),
        other_velocity=in_ego_frame(collision.other_velocity),
        ego_mass=settings.ego_mass,
        other_mass=settings.other_mass,
        overlap=collision.overlap,
        side=collision.side,
        angle=math.remainder(collision.other_pose[2] - heading, 2.0 * math.pi),
        other=collision.other,
    )


class InjuryCurve(NamedTuple):
    """logit P = `intercept` + `speed` * (closing speed in km/h) + `age` * (age in years).

    intercept, speed, age: coefficients, for the person that is hit.
    usual_age: years, used where the setting `method.collision.age` is None. The source publishes
        the speed of a 10 % risk: at this age the curve gives 10 % at that speed.
    fastest: km/h; above it a score has a note that the curve may not hold.
    """

    intercept: float
    speed: float
    age: float
    usual_age: float
    fastest: float


INJURY_CURVES: Mapping[str, InjuryCurve] = {
    "car_driver": InjuryCurve(-7.654, 0.041, 0.021, 41.0, 150.0),
    "pedestrian": InjuryCurve(-6.190, 0.078, 0.038, 46.0, 100.0),
    "cyclist": InjuryCurve(-7.467, 0.079, 0.047, 38.0, 100.0),
}
"""MAIS3+ or death, from N. Lubbe, Y. Wu, H. Jeppsson, "Safe speeds: fatality and injury risks of
pedestrians, cyclists, motorcyclists, and car drivers impacting the front of another passenger
car as a function of closing speed and age", Traffic Safety Research 2, 000006 (2022), on German
in-depth accident data (GIDAS).
"""
INJURY_AGES = (15.0, 95.0)
"""Least and largest age, years; outside them a score has a note that the curve may not hold. The
setting `method.collision.age` allows more.

These ages and `fastest` are bounds of this project, because the source's abstract states none.
"""
_INJURY = "injury:"
CHOICES = ("severity", "eq14", *(_INJURY + name for name in INJURY_CURVES))
"""The severities that ship."""


def injury_risk(who: str, closing_speed: ArrayLike, age: float | None = None) -> FloatArray:
    """P(MAIS3+ or death) = 1 / (1 + exp(-(b0 + b1 v + b2 age))), v in km/h, any shape, 0..1 (Lubbe
    et al. 2022).

    who: `car_driver`, `pedestrian` or `cyclist`.
    closing_speed: m/s, any shape, `Contact.closing_speed`.
    age: years; None: the curve's `usual_age`.

    Raises InputError for another name, and for speeds and ages that are negative or not finite.
    """
    check_known("injury-risk curve", INJURY_CURVES, who)
    curve = INJURY_CURVES[who]
    owner = f"injury-risk curve `{who}`"
    speed = not_negative(owner, "closing_speed", closing_speed)
    years = not_negative(owner, "age", curve.usual_age if age is None else age)
    logit = curve.intercept + curve.speed * KMH * speed + curve.age * years
    # `[()]` makes a number of an array without axes
    return np.asarray(1.0 / (1.0 + np.exp(-logit)))[()]


class Severity(NamedTuple):
    """The severity V that the settings choose.

    name: as in the settings.
    unit: of V.
    of: function of a collision and the name of its case (for error messages): V. Raises InputError
        where a user's function fails, returns anything but a finite number within 0..1, or returns
        two different numbers for one contact.
    beyond: function of a collision: why V may not hold for it, or "".
    sha256: hash of the file that holds a user's function, so that scores identify it; empty for
        severities that ship.
    """

    name: str
    unit: str
    of: Callable[[Collision, str], float]
    beyond: Callable[[Collision], str] = lambda hit: ""
    sha256: str = ""


EXAMPLE = Collision(
    0.0, "example", (20.0, 0.0), (0.0, 0.0), 1.0, "front", (0.0, 0.0, 0.0), (4.5, 0.0, 0.0)
)
"""Contact at t = 0 of an ego at 20 m/s with a standing car, at the full width of the bumper. The
poses are x, y, heading."""


def severity_of(settings: CollisionSettings, folder: Path | None = None) -> Severity:
    """The severity that the settings choose.

    settings: `[method.collision]`.
    folder: where a locator's relative path starts; None: the working directory.

    Raises InputError for an unknown choice, for a locator that leads nowhere, and for a user's
    function that returns no loss for an example.
    """
    chosen = settings.severity
    if chosen in ("severity", "eq14"):
        return Severity(
            chosen,
            "m/s",
            lambda hit, case: float(
                impact_severity(hit.ego_velocity, hit.other_velocity, hit.overlap)
            ),
        )
    if chosen.startswith(_INJURY):
        return _injury(chosen, settings)
    if ":" not in chosen:
        raise unknown("severity", chosen, [*CHOICES, "package.module:function"])
    function = load_object(chosen, folder, "Severity")
    if not callable(function):
        wanted = "a function of a Contact"
        raise must_be(f"Severity `{chosen}`", "`CollisionSettings`", wanted, function)
    severity = _of_function(chosen, function, settings)
    # once on an example, so that a wrong function is known before the first case
    severity.of(EXAMPLE, "an example, 20 m/s into a standing car in line")
    return severity


def _of_function(
    name: str, function: Callable[[Contact], float], settings: CollisionSettings
) -> Severity:
    """The severity of a user's function, whose answers are checked.

    name: its locator, as in the settings.
    """

    def answer(contact: Contact, case: str) -> float:
        """The loss that the function returns."""
        with users_code(f"The severity `{name}` failed for {case}"):
            loss = function(contact)
        is_number = isinstance(loss, int | float | np.integer | np.floating)
        if isinstance(loss, bool) or not is_number or not 0.0 <= loss <= 1.0:
            raise InputError(
                f"The severity `{name}` must return a finite number within 0..1, got "
                f"{shown(loss)} for {case}."
            )
        return float(loss)

    def loss_of(hit: Collision, case: str) -> float:
        """The loss that the function returns, twice the same for one contact."""
        contact = contact_of(hit, settings)
        first, second = answer(contact, case), answer(contact, case)
        if first != second:
            raise InputError(
                f"The severity `{name}` must return one number for one contact, got "
                f"{first!r} and then {second!r} for {case}."
            )
        return first

    return Severity(name, "loss", loss_of, sha256=_hash_of(function))


def _hash_of(function: object) -> str:
    """SHA-256 of the file that holds a function; empty without a file."""
    while isinstance(function, partial):  # its module is functools, not the user's
        function = function.func
    module = sys.modules.get(getattr(function, "__module__", ""))
    file = getattr(module, "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""


def _injury(chosen: str, settings: CollisionSettings) -> Severity:
    """The severity of an injury-risk curve.

    chosen: its name with `injury:` before it.
    """
    who = chosen.removeprefix(_INJURY)
    injury_risk(who, 0.0, settings.age)  # raises InputError for an unknown curve or age
    curve = INJURY_CURVES[who]
    age = curve.usual_age if settings.age is None else settings.age
    youngest, oldest = INJURY_AGES

    def beyond(hit: Collision) -> str:
        """Why the curve may not hold for a collision, or ""."""
        reasons = {
            f"closing speed over {curve.fastest:g} km/h": KMH * hit.relative_speed > curve.fastest,
            f"age outside {youngest:g}..{oldest:g} years": not youngest <= age <= oldest,
            f"contact at the ego's {hit.side}, not its front": hit.side != "front",
        }
        return "; ".join(reason for reason, applies in reasons.items() if applies)

    return Severity(
        chosen,
        "probability of MAIS3+ or death",
        lambda hit, case: float(injury_risk(who, hit.relative_speed, age)),
        beyond,
    )
