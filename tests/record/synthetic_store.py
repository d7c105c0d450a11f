"""A facts file of any size without a simulation."""

import numpy as np
from road_scenes import at_values

from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.store import open_store
from sumo_eval.trajectory import Collision, Recording, Trajectory


def outcomes(rows):
    """So many drives of one ADS, every tenth with a collision, every hundredth crashed."""
    concrete = at_values("front_vehicle_low_speed", ego_speed=20, lead_speed=10)
    time = np.arange(0.0, 5.0, 0.1)
    drive = Trajectory(time, 20.0 * time, np.zeros(time.size))
    pose = (100.0, 0.0, 0.0)
    hit = Collision(4.9, "lead", (20.0, 0.0), (10.0, 0.0), 1.0, "front", pose, pose)
    for number in range(rows):
        case = Case(number, concrete, "ads", "idm", "idm", fingerprint=f"{number:064x}")
        if number % 100 == 99:
            yield Outcome(case, "crashed", None, "The process died.")
        elif number % 10 == 0:
            yield Outcome(case, "collision", Recording(drive, {"lead": drive}, hit, "contact"))
        else:
            yield Outcome(case, "ok", Recording(drive, {"lead": drive}, None, "road_end"))


def use(folder, rows):
    """Write so many rows, then ask what a parent asks: each case, the counts, the collisions, the
    digest."""
    folder.mkdir()
    with open_store(folder, create=True) as store:
        for outcome in outcomes(rows):
            if not store.holds(outcome.case):
                store.add(outcome)
        counted = sum(count.drives for count in store.counts())
        seen = sum(1 for _ in store.facts("ads"))
        hits = sum(fact.collision is not None for fact in store.facts("ads"))
        store.digest()
    return counted, seen, hits
