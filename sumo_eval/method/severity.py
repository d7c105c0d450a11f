"""Severity of a contact: the number V that replaces U in Eqs. 15-17, and in the avoided share A.

`scoring/` computes V of each contact. `method.collision.severity` chooses it:

- `severity`: U of Eq. 15, m/s, as the paper prints it;
- `eq14`: U as well; the scores are then computed from its class L of Eq. 14;
- `injury:car_driver`, `injury:pedestrian`, `injury:cyclist`: the probability that a contact with
  the front of a car injures this person seriously or fatally (MAIS3+ or death), by closing speed
  and the person's age (Lubbe, Wu, Jeppsson 2022);
- `package.module:function` or `file.py:function`: a function of one `Contact` that returns a loss
  within 0..1.

V replaces U in every equation. V_g of the ideal vehicle's contact replaces Ug_i, and V_0 of the
contact of `no_reaction` replaces U0_i. Without a contact V is 0, and L of Eq. 14 is 0.1. So

    C = sum(r V_g / V) / sum(r)
    A = 1 - sum(w max(0, V - V_g)) / sum(w max(0, V_0 - V_g))

Users: `cli/tools.py`, `evaluation.py`, `record/facts.py`, `record/trust.py`,
`scoring/quantities.py`, `scoring/space.py`, `scoring/steps.py`.
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
from sumo_eval.trajectory import Collision, FloatArray, Side

KMH = 3.6
"""km/h in a m/s."""


class Contact(NamedTuple):
    """First contact of a case, which a user's severity function receives; vectors are in the ego's
    frame, x ahead and y to its left.

    ego_velocity, other_velocity: m/s.
    ego_mass, other_mass: kg (`method.collision`).
    overlap: share of the ego's bumper width that faces the other, 0..1.
    side: where on the ego it was hit.
    angle: the other's heading less the ego's, rad within -pi..pi, 0 for a rear-end contact in line.
    other: the other's name in the scenario.
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
    """The contact of a recorded collision."""
    heading = collision.ego_pose[2]
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

    intercept, speed, age: coefficients of a person that is hit.
    usual_age: years, where `method.collision.age` is None. The source publishes the speed of a 10 %
        risk. At this age the curve gives 10 % at that speed.
    fastest: km/h above which a score has a note that the curve may not hold.
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
"""Years; outside them a score has a note that the curve may not hold. The bounds of
`CollisionSettings.age` are wider.

This and `fastest` are bounds of this project: the source's abstract states none.
"""
_INJURY = "injury:"


def injury_risk(who: str, closing_speed: ArrayLike, age: float | None = None) -> FloatArray:
    """P(MAIS3+ or death) = 1 / (1 + exp(-(b0 + b1 v + b2 age))), v in km/h, any shape, 0..1 (Lubbe
    et al. 2022).

    who: `car_driver`, `pedestrian` or `cyclist`.
    closing_speed: m/s, any shape.
    age: years; None: the curve's own.
    Raises InputError for another name, and for speeds and ages that are negative or not finite.
    """
    check_known("injury-risk curve", INJURY_CURVES, who)
    curve = INJURY_CURVES[who]
    owner = f"injury-risk curve `{who}`"
    speed = not_negative(owner, "closing_speed", closing_speed)
    years = not_negative(owner, "age", curve.usual_age if age is None else age)
    logit = curve.intercept + curve.speed * KMH * speed + curve.age * years
    # `[()]`: a number for a number, not an array of no dimension
    return np.asarray(1.0 / (1.0 + np.exp(-logit)))[()]


class Severity(NamedTuple):
    """The chosen number V of a contact.

    name: as in the settings.
    unit: of V.
    of: takes a collision and the name of its case (for error messages), returns V. Raises
        InputError where a user's function fails, returns anything but a finite number within 0..1,
        or returns two different numbers for one contact.
    beyond: takes a collision, returns why V may not hold for it, or "".
    sha256: of the file that holds a user's function, so that scores identify it; empty for any
        other severity.
    """

    name: str
    unit: str
    of: Callable[[Collision, str], float]
    beyond: Callable[[Collision], str] = lambda hit: ""
    sha256: str = ""


def severity_of(settings: CollisionSettings, folder: Path | None = None) -> Severity:
    """The severity that the settings choose.

    folder: where a locator's relative path starts.

    A user's function is called once on an example contact, so that a wrong one is known before the
    first case.

    Raises InputError for an unknown choice, for a locator that leads nowhere, and for a function
    that answers wrongly.
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

    def answer(hit: Collision, case: str) -> float:
        """The number that the user's function returns; a second call must return the same."""
        contact = contact_of(hit, settings)
        losses = []
        for _ in range(2):
            with users_code(f"The severity `{chosen}` failed for {case}"):
                loss = function(contact)
            number = isinstance(loss, int | float | np.integer | np.floating)
            if isinstance(loss, bool) or not number or not 0.0 <= float(loss) <= 1.0:
                raise InputError(
                    f"The severity `{chosen}` must return a finite number within 0..1, got "
                    f"{loss!r} for {case}."
                )
            losses.append(float(loss))
        if losses[0] != losses[1]:
            raise InputError(
                f"The severity `{chosen}` must return one number for one contact, got "
                f"{losses[0]!r} and then {losses[1]!r} for {case}."
            )
        return losses[0]

    answer(EXAMPLE, "an example, 20 m/s into a standing car in line")
    return Severity(chosen, "loss", answer, sha256=_hash_of(function))


CHOICES = ("severity", "eq14", *(_INJURY + name for name in INJURY_CURVES))
"""The severities that ship."""
EXAMPLE = Collision(
    0.0, "example", (20.0, 0.0), (0.0, 0.0), 1.0, "front", (0.0, 0.0, 0.0), (4.5, 0.0, 0.0)
)
"""The ego at 20 m/s meets a standing car in line, bumper to bumper at the full width."""


def _hash_of(function: object) -> str:
    """SHA-256 of the file that holds a function; empty without a file."""
    while isinstance(function, partial):  # its own module is functools
        function = function.func
    module = sys.modules.get(getattr(function, "__module__", ""))
    file = getattr(module, "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""


def _injury(chosen: str, settings: CollisionSettings) -> Severity:
    """The severity of an injury-risk curve."""
    who = chosen.removeprefix(_INJURY)
    age = settings.age
    injury_risk(who, 0.0, age)  # raises InputError for an unknown curve or age

    def beyond(hit: Collision) -> str:
        curve = INJURY_CURVES[who]
        years = curve.usual_age if age is None else age
        reasons = [
            f"closing speed over {curve.fastest:g} km/h"
            if KMH * hit.relative_speed > curve.fastest
            else "",
            f"age outside {INJURY_AGES[0]:g}..{INJURY_AGES[1]:g} years"
            if not INJURY_AGES[0] <= years <= INJURY_AGES[1]
            else "",
            f"contact at the ego's {hit.side}, not its front" if hit.side != "front" else "",
        ]
        return "; ".join(reason for reason in reasons if reason)

    return Severity(
        chosen,
        "probability of MAIS3+ or death",
        lambda hit, case: float(injury_risk(who, hit.relative_speed, age)),
        beyond,
    )
