"""The page of the browser, for `Window`, and the views that `trip` and `study` show in it.

Users: `extras/wheel/command.py`, `extras/wheel/study.py`, `extras/wheel/trip.py`.
"""

from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

from sumo_eval.record.store import EGO
from sumo_eval.report.page import Json, asset
from sumo_eval.report.page_data import drawn_bodies, drawn_road
from sumo_eval.report.sent_drives import CHANNEL_STEPS, contact, encode_trajectories
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Collision, Trajectories

VIEW = 600.0  # m of road that are drawn before the ego's start and beyond the road's end
_TEMPLATES = files("sumo_eval.extras.wheel") / "templates"


def _own(name: str) -> Markup:
    """A file of this package that goes into the page as it is."""
    return Markup((_TEMPLATES / name).read_text("utf-8"))  # noqa: S704


def page(title: str) -> str:
    """The page as HTML.

    It has `{nonce}` where the server inserts the nonce of its content security policy.
    """
    template: jinja2.Template = jinja2.Template(
        _own("drive.html.j2"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return template.render(
        title=title, css=_own("drive.css") + asset("replay.css"), field_js=asset("field.js"),
        scene_js=asset("scene3d.js"), replay_js=asset("replay.js"), drive_js=_own("drive.js")
    )  # fmt: skip


def drive_view(
    concrete: ConcreteScenario, settings: SimulationSettings, title: str, lines: tuple[str, ...]
) -> Json:
    """The view of a drive: the road and the bodies; their positions come with every state.

    title, lines: text shown until the drive begins.
    """
    vehicle = concrete.simulation(settings).vehicle
    return {
        "title": title, "lines": lines, "step": settings.step, "wanted": concrete.ego.speed,
        "scene": {
            "road": drawn_road(concrete.road),
            "extent": [concrete.ego.x - VIEW, concrete.road.length + VIEW],
            "ego": {"kind": "car", "length": vehicle.length, "width": vehicle.width},
            "others": [{"kind": it.body, "length": it.length,
                "width": it.width} for it in concrete.actors]
        }
    }  # fmt: skip


def replay(
    concrete: ConcreteScenario, name: str, vehicles: Trajectories, collision: Collision | None
) -> Json:
    """A drive for the page's player.

    name: of the drive, in the player.
    vehicles: trajectories by name; that of the ego is `ego`.
    """
    return {
        "channels": CHANNEL_STEPS, "road": drawn_road(concrete.road),
        "bodies": drawn_bodies(concrete),
        "views": [{"name": name, "vehicles": {it: k for k, it in enumerate(vehicles)},
            "contact": contact(collision, vehicles[EGO])}],
        "trajectories": encode_trajectories(list(vehicles.values()))
    }  # fmt: skip


def sheet(title: str, *lines: str, **more: Any) -> Json:
    """A view of text, questions and buttons."""
    return {"show": "sheet", "title": title, "lines": lines, **more}
