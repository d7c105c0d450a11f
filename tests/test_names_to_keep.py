"""Names that users' code and other tools call: importable from where they stand, with their
parameters."""

import importlib
import inspect

import pytest
from tables import rows_of

KEPT = dict(
    rows_of("""
sumo_eval.method.criticality:max_inverse_ttc | ego_speed, lead_speed, gap, deceleration, delay
sumo_eval.method.criticality:ideal_impact_speed
| ego_speed, lead_speed, gap, deceleration, delay, build_up
sumo_eval.method.trajectory_field:trajectory_field | points, trajectory, k1, k2
sumo_eval.method.anthropomorphic:anthropomorphic_index | ads, drivers, road, settings
sumo_eval.method.anthropomorphic:count_operations | trajectory, settings
sumo_eval.method.anthropomorphic:exposure_weighted_index | values, exposure
sumo_eval.method.collision_avoidance:impact_severity | ego_velocity, obstacle_velocity, overlap
sumo_eval.method.collision_avoidance:collision_loss | u
sumo_eval.method.collision_avoidance:collision_weight | point, partition
sumo_eval.method.collision_avoidance:collision_avoidance_index | u, u_ideal, weights
sumo_eval.method.zone_partition:partition | logical, settings
sumo_eval.method.score:combined_score | c, d, a, b, k5, k6
sumo_eval.trajectory:Trajectory | time, x, y, heading, speed, acceleration, steering_wheel_angle
sumo_eval.cosim:simulate | concrete, controller, settings
sumo_eval.cosim:simulate_many | cases, controller, settings
sumo_eval.scenario.catalogue:load | name
sumo_eval:evaluate | out
sumo_eval:score | run, changes
sumo_eval:open_run | path
sumo_eval:Command | acceleration, steering
""")
)
"""`module:name` and the parameters that may be given by name; others may stand beside them."""

FIELDS = {
    "sumo_eval.method.anthropomorphic:AnthropomorphicIndex": "value, length_factor, "
    "operation_factor, similarity",
    "sumo_eval.method.score:Score": "total, c, d",
    "sumo_eval.method.zone_partition:ZonePartition": "hazardous, boundary_distance, most_dangerous",
    "sumo_eval.trajectory:Recording": "ego, actors, collision, end_reason, clips",
    "sumo_eval.scenario.logical:LogicalScenario": "parameters, concrete",
    "sumo_eval.scenario.logical:Parameter": "name, low, high, unit",
}


def found(place):
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


@pytest.mark.parametrize("place", KEPT)
def test_a_function_is_where_it_was_and_takes_what_it_took(place):
    function = found(place)
    assert callable(function)
    assert set(filter(None, KEPT[place].split(", "))) <= set(inspect.signature(function).parameters)


@pytest.mark.parametrize("place", FIELDS)
def test_a_record_has_what_it_had(place):
    assert set(FIELDS[place].split(", ")) <= {
        *dir(found(place)),
        *getattr(found(place), "__dataclass_fields__", {}),
    }
