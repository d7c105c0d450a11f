"""What stands in the place of U: the paper's, injury risks against their published anchors, and a
user's function."""

import math
from dataclasses import replace

import pytest
from evaluations import settings_of
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal
from tables import rows_of

from sumo_eval.method.collision_avoidance import collision_loss, impact_severity
from sumo_eval.method.severity import (
    CHOICES,
    EXAMPLE,
    INJURY_CURVES,
    contact_of,
    injury_risk,
    severity_of,
)
from sumo_eval.settings import CollisionSettings
from sumo_eval.settings.config import settings_from, to_plain

GRAZE = replace(
    EXAMPLE, ego_velocity=(25.0, 1.0), other_velocity=(15.0, 0.0), overlap=0.3, other="obstacle"
)

FUNCTIONS = """
calls = 0

def by_closing_speed(contact):
    return min(contact.closing_speed / 40.0, 1.0)

def by_everything(contact):
    momentum = contact.ego_mass / (contact.ego_mass + contact.other_mass)
    return momentum * contact.overlap * (contact.side == "front") * abs(contact.angle)

def too_large(contact):
    return 1.5

def endless(contact):
    return 10**5000

def not_a_number(contact):
    return float("nan")

def in_words(contact):
    return "severe"

def raises(contact):
    raise RuntimeError("no table at this speed")

def wavers(contact):
    global calls
    calls += 1
    return calls / 1000.0

def hard_hits_only(contact):
    return 0.5 if contact.closing_speed > 15.0 else -1.0

table = {1: 2}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(FUNCTIONS)
    return tmp_path


def test_the_papers_severity_and_class_are_eqs_15_and_14():
    u, under_classes = (
        severity_of(CollisionSettings(severity=name)).of(GRAZE, "a case") for name in CHOICES[:2]
    )
    assert u == impact_severity((25.0, 1.0), (15.0, 0.0), 0.3) == math.hypot(10.0, 1.0) / 0.5
    assert under_classes == u
    assert collision_loss(u) == 1.0


def test_eq14_and_the_loss_class_are_two_names_of_one_choice():
    assert CollisionSettings(severity="eq14").loss == "class"
    with refusal("'severity' or 'eq14' beside `loss` 'class', got 'injury:cyclist'"):
        CollisionSettings(loss="class", severity="injury:cyclist")


@pytest.mark.parametrize(
    "who, speed", [("pedestrian", 29.0), ("cyclist", 44.0), ("car_driver", 112.0)]
)
def test_the_published_ten_percent_lies_within_the_rounding_of_the_coefficients(who, speed):
    """The coefficients have three digits after the point and the speed none: b0, b1 v and b2 age
    are known to 0.0005, 0.0005 v and 0.0005 age, the speed to 0.5 km/h.
    """
    curve = INJURY_CURVES[who]
    risk = float(injury_risk(who, speed / 3.6))
    logit = math.log(risk / (1.0 - risk))
    known_to = 0.0005 * (1.0 + speed + curve.usual_age) + 0.5 * curve.speed
    assert abs(logit - math.log(0.1 / 0.9)) < known_to
    assert risk == pytest.approx(0.1, abs=0.003)


def test_an_injury_risk_by_hand():
    # Pedestrian of 60 at 50 km/h: -6.190 + 0.078 * 50 + 0.038 * 60 = -0.01; 1 / (1 + e^0.01) =
    # 0.4975.
    assert injury_risk("pedestrian", 50.0 / 3.6, 60.0) == pytest.approx(0.4975, abs=5e-5)
    chosen = severity_of(CollisionSettings(severity="injury:pedestrian", age=60.0))
    # the overlap has no part in it
    hit = replace(EXAMPLE, ego_velocity=(50.0 / 3.6, 0.0), overlap=0.5)
    assert chosen.of(hit, "a case") == pytest.approx(0.4975, abs=5e-5)
    assert chosen.unit == "probability of MAIS3+ or death"


@given(
    st.sampled_from(list(INJURY_CURVES)),
    st.floats(0.0, 60.0),
    st.floats(0.0, 20.0),
    st.floats(15.0, 90.0),
)
def test_a_faster_contact_and_an_older_person_are_never_at_less_risk(who, speed, more, age):
    risk = injury_risk(who, speed, age)
    assert 0.0 < risk <= injury_risk(who, speed + more, age) < 1.0
    assert risk <= injury_risk(who, speed, age + more)


def test_who_walks_is_at_more_risk_than_who_rides_and_who_drives():
    risks = [float(injury_risk(who, 15.0, 45.0)) for who in ("pedestrian", "cyclist", "car_driver")]
    assert risks == sorted(risks, reverse=True)


def test_what_lies_outside_the_range_of_a_curve_is_said():
    chosen = severity_of(CollisionSettings(severity="injury:cyclist"))
    assert chosen.beyond(EXAMPLE) == ""
    fast = replace(EXAMPLE, ego_velocity=(30.0, 0.0), side="left")
    assert (
        chosen.beyond(fast)
        == "closing speed over 100 km/h; contact at the ego's left, not its front"
    )
    old = severity_of(CollisionSettings(severity="injury:cyclist", age=99.0))
    assert old.beyond(EXAMPLE) == "age outside 15..95 years"


def test_a_contact_is_seen_from_the_ego():
    heading = 0.3
    turned = replace(
        EXAMPLE,
        ego_velocity=(20.0 * math.cos(heading), 20.0 * math.sin(heading)),
        other_velocity=(0.0, 5.0),
        ego_pose=(10.0, 2.0, heading),
        other_pose=(14.0, 2.0, -math.pi),
    )
    contact = contact_of(turned, CollisionSettings(ego_mass=2000.0))
    assert contact.ego_velocity == pytest.approx((20.0, 0.0))
    assert contact.other_velocity == pytest.approx(
        (5.0 * math.sin(heading), 5.0 * math.cos(heading))
    )
    assert contact.closing_speed == pytest.approx(turned.relative_speed)
    assert contact.angle == pytest.approx(math.pi - heading)
    assert contact.ego_mass == 2000.0
    assert contact.other_mass == 1500.0
    assert contact.other == "example"
    assert contact.side == "front"


def test_partial_function_is_identified_by_its_own_file(tmp_path):
    hashes = set()
    for name, of in (("one", 0.1), ("two", 0.2)):
        lines = ["from functools import partial", "def loss(hit, of): return of",
                 f"own = partial(loss, of={of})"]  # fmt: skip
        (tmp_path / f"{name}.py").write_text("\n".join(lines))
        hashes.add(severity_of(CollisionSettings(severity=f"{name}.py:own"), tmp_path).sha256)
    assert len(hashes) == 2


def test_an_own_function_replaces_u(folder):
    chosen = severity_of(CollisionSettings(severity="mine.py:by_closing_speed"), folder)
    assert chosen.of(EXAMPLE, "a case") == 20.0 / 40.0
    assert chosen.unit == "loss"
    at_an_angle = replace(EXAMPLE, overlap=0.5, other_pose=(4.5, 0.0, 0.4))
    everything = severity_of(
        CollisionSettings(severity="mine.py:by_everything", other_mass=500.0), folder
    )
    assert everything.of(at_an_angle, "a case") == pytest.approx(0.75 * 0.5 * 0.4)


@pytest.mark.parametrize(
    "name, sentence",
    [
        *rows_of("""
mine.py:too_large | must return a finite number within 0..1, got 1.5 for an example
mine.py:endless | within 0..1, got .int that cannot be shown: ValueError. for an example
mine.py:not_a_number | within 0..1, got nan for an example
mine.py:in_words | got 'severe' for an example
mine.py:raises | failed for an example, .*: RuntimeError: no table at this speed
mine.py:table | must be a function of a Contact
mine.py:by_closing_sped | Did you mean `by_closing_speed`
injury:cyclst | Unknown injury-risk curve `cyclst`. Did you mean `cyclist`
eq41 | Unknown severity `eq41`. Did you mean `eq14`
"""),
        ("mine.py:wavers", "must return one number for one contact, got .* and then "),
    ],
)
def test_a_wrong_severity_is_known_before_the_first_case(folder, name, sentence):
    with refusal(sentence):
        severity_of(CollisionSettings(severity=name), folder)


def test_a_wrong_answer_names_the_case(folder):
    chosen = severity_of(CollisionSettings(severity="mine.py:hard_hits_only"), folder)
    with refusal(r"mine.py:hard_hits_only` must return .* got -1.0 for case cut_in 7"):
        chosen.of(GRAZE, "case cut_in 7")


@pytest.mark.parametrize("name", CHOICES)
def test_every_choice_survives_the_evaluation_file(name):
    read = settings_of(method={"collision": {"severity": name, "age": 60.0}})
    assert read.method.collision.severity == name
    assert settings_from(to_plain(read), "file") == read
