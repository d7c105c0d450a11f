"""The run that tests share: recorded, scored and reported once in a session, by whichever test
process comes first.

Two scenarios of three levels an axis, one of two parameters and one of three; four ADSs:
`no_reaction` collides in the safe zone, `ideal_braking` is the ideal vehicle; four synthetic
drivers. As `sumo-eval run` leaves it.
"""

import fcntl

from commands import sumo_eval

ADS = ("ideal_braking", "idm", "lane_changer", "no_reaction")
SCENARIOS = ("front_vehicle_low_speed", "front_vehicle_cut_out")
EVALUATION = (
    'name = "standard"\n'
    + "".join(
        f'[[scenario]]\nuse = "{name}"\n[scenario.sampling]\nlevels = 3\n' for name in SCENARIOS
    )
    + "".join(f'[[ads]]\nname = "{name}"\ncontroller = "{name}"\n' for name in ADS)
    + "[drivers]\ncount = 4\n[run]\nworkers = 2\n"
)


def recorded_once(folder):
    """Return the shared run below a folder that all test processes of a session know; record it if
    it is not there."""
    folder.mkdir(exist_ok=True)
    run, complete = folder / "run", folder / "complete"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            (folder / "evaluation.toml").write_text(EVALUATION)
            sumo_eval(f"run {folder}/evaluation.toml --out {run}")
            complete.touch()
    return run


def state(run):
    """Size (B) and time of the last change (ns) of each file but that of kept results, which every
    score touches."""
    found = {
        path: path.stat()
        for path in sorted(run.rglob("*"))
        if path.is_file() and path.stem != "kept"
    }
    return {
        str(path.relative_to(run)): (one.st_size, one.st_mtime_ns) for path, one in found.items()
    }
