"""The report in a browser: it draws without an error, asks nobody for anything, and computes the
method's own field."""

import json
from importlib.resources import files

import builders
import numpy as np
import pytest
from browser import Page, needs_chromium, needs_node, node, plain
from builders import CALM, CUT_OUT, HOSTILE, SCENARIOS
from packed_pages import unpacked, with_packed
from page_checks import CONTRAST, WRITTEN_IN_CELLS, press, size
from report_cases import pick
from tables import in_campaign

from sumo_eval import Trajectory
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.report.sent_drives import CHANNEL_STEPS, encode_trajectories
from sumo_eval.report.words import LOOKS
from sumo_eval.scoring.preventability import verdicts

FIELD_JS = str(files("sumo_eval.report") / "templates" / "field.js")


def in_the_page(program, given):
    """What a program that reads `given` and knows `sumoEval` gives."""
    return node(
        f"""
        const sumoEval = require({json.dumps(FIELD_JS)});
        (async () => {{ {program} }})().then((result) => console.log(JSON.stringify(result)));
        """,
        given,
    )


def look_at(page, case):
    page.run(f"(location.hash = '#case:' + encodeURIComponent({json.dumps(case)}), null)")


def turning():
    """Turns once around, so that headings jump by 2 pi, and ends off the 0.1 s grid."""
    time = np.append(np.arange(0.0, 8.0, 0.1), 8.04)
    angle = 0.9 * time
    return Trajectory(time, 60.0 + 20.0 * np.sin(angle), 20.0 * (1.0 - np.cos(angle)))


def standing():
    return Trajectory(
        np.arange(0.0, 5.0, 0.1), np.full(50, 60.0), np.full(50, 1.0), speed=np.zeros(50)
    )


def steered():
    return Trajectory(
        [0.0, 0.1, 0.2], [50.0, 52.0, 54.0], np.zeros(3), steering_wheel_angle=[0.0, 0.5, -1.25]
    )


def coarse():
    return Trajectory([0.0, 0.25, 0.9, 2.0], [50.0, 56.0, 71.0, 96.0], [0.0, 0.1, 0.3, 0.2])


@needs_node
@pytest.mark.parametrize(
    "make", [turning, standing, coarse, lambda: builders.drive(50.0, 0.0, 30.0, 6.0, offset=3.5)]
)
@pytest.mark.parametrize(
    "k1, k2",
    [
        (0.73, 0.01),
        *(in_campaign(*it) for it in [(0.5, 0.005), (1.0, 0.05), (2.0, 0.0)]),
    ],
)
@pytest.mark.parametrize("superposition", ["magnitude", "vector"])
def test_the_page_computes_the_field_of_the_method(make, k1, k2, superposition):
    trajectory = make()
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.uniform(40.0, 110.0, 60), rng.uniform(-3.0, 6.0, 60)])
    points[0] = trajectory.x[0], trajectory.y[0]  # on the path itself
    given = {
        "points": {"x": points[:, 0].tolist(), "y": points[:, 1].tolist()},
        "trajectory": plain(trajectory),
        "options": {"k1": k1, "k2": k2, "sample_interval": 0.1, "superposition": superposition},
    }
    there = in_the_page(
        "return Array.from(sumoEval.trajectoryField(given.points, given.trajectory, "
        "given.options));",
        given,
    )
    here = trajectory_field(points, trajectory, k1=k1, k2=k2, superposition=superposition)
    np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-9)


@needs_node
def test_trajectories_come_back_from_the_page_to_their_steps():
    sent = [
        turning(),
        standing(),
        coarse(),
        Trajectory([0.0], [-12.345], [0.0015], speed=[3.0]),
        steered(),
    ]
    program = """
        const all = await sumoEval.decodeTrajectories(given.packed, given.steps);
        const plain = (value) => value.length === undefined ? value : Array.from(value);
        return all.map((t) => Object.fromEntries(Object.entries(t).map(([name, value]) => [name, plain(value)])));
    """
    received = in_the_page(program, {"packed": encode_trajectories(sent), "steps": CHANNEL_STEPS})
    assert len(received) == len(sent)
    for there, here in zip(received, sent, strict=True):
        assert there["length"] == here.length
        assert there["width"] == here.width
        for name, step in CHANNEL_STEPS.items():
            # JSON has no nan, so what is not known comes as null
            values = np.array(there[name], dtype=float)
            np.testing.assert_allclose(values, getattr(here, name), rtol=0, atol=0.5 * step + 1e-9)


@needs_node
def test_extreme_samples_come_back_from_the_page_as_they_were():
    # 1073741823 steps are the last that differences of 32 bits hold: of x 10,737,418.23 m, of speed
    # as much in m/s
    edge = (2**30 - 1) * 1e-2
    lost = -1073741824.0  # what SUMO answers for a vehicle that is on no lane
    x = [0.0, edge, -edge, lost, lost, 1e300, -1.7e308, 1.7e308, 1e9, edge + 1.0, 5.25]
    sent = [
        turning(),
        Trajectory(
            0.05 * np.arange(len(x)),
            x,
            [0.0] * len(x),
            speed=x[::-1],
            acceleration=x,
            heading=[1e9] * len(x),
        ),
        Trajectory(
            [0.0, 1e12],
            [lost, 1.0],
            [1.0, lost],
            speed=[3.0, 4.0],
            steering_wheel_angle=[0.5, 1e30],
        ),
        standing(),
    ]
    packed = encode_trajectories(sent)
    assert [entry[1:] for entry in packed["beyond"] if entry[0] == "heading"] == [
        [len(sent[0]), len(x), 1e9]
    ]
    json.dumps(packed, allow_nan=False)
    program = """
        const all = await sumoEval.decodeTrajectories(given.packed, given.steps);
        return all.map((t) => Object.keys(given.steps).map((name) => Array.from(t[name], String)));
    """
    received = in_the_page(program, {"packed": packed, "steps": CHANNEL_STEPS})
    for there, here in zip(received, sent, strict=True):
        for (name, step), words in zip(CHANNEL_STEPS.items(), there, strict=True):
            values, meant = np.array([float(word) for word in words]), getattr(here, name)
            if name == "steering_wheel_angle" and not np.isfinite(meant).all():
                assert np.isnan(values).all()
                continue
            with np.errstate(over="ignore"):
                far = ~(np.abs(np.round(meant / step)) <= 2**30 - 1)
            np.testing.assert_array_equal(values[far], meant[far])  # to the last bit
            np.testing.assert_allclose(
                values[~far], meant[~far], rtol=1e-12, atol=0.5 * step + 1e-9
            )


@pytest.fixture
def opened(page_opened):
    yield page_opened
    assert page_opened.problems == []


@pytest.fixture(scope="module")
def page_opened(report, tmp_path_factory):
    with Page(tmp_path_factory.mktemp("profile")) as page:
        page.open(report.as_uri(), "document.documentElement.dataset.report === 'ready'")
        for width, height in ((390, 844), (1400, 900)):
            size(page, width, height)
            screens = page.run("document.documentElement.scrollHeight") / height
            assert screens <= 3.0, (
                f"{screens:.2f} screens of {width} px before anything is unfolded"
            )
        page.call("Emulation.clearDeviceMetricsOverride")
        page.run(
            "document.querySelectorAll('details.fold').forEach((fold) => { fold.open = true; })"
        )
        page.wait("document.documentElement.dataset.fields === 'drawn'")
        yield page


@needs_chromium
def test_the_report_opens_without_an_error_and_without_a_request(opened, report):
    assert opened.asked_for() == [report.as_uri()]
    assert opened.run("document.getElementById('failure').hidden")
    assert (
        opened.run("document.querySelectorAll('script, img, iframe, link').length") == 9
    )  # 7 scripts, the icon and Plotly unpacked
    assert opened.run("document.querySelectorAll('.js-plotly-plot').length") >= 10
    assert opened.run("document.querySelector('[data-tools] button').textContent") == "Fold all"


@needs_chromium
def test_hostile_names_stay_text_in_the_charts(opened):
    assert opened.run("document.querySelectorAll('img').length") == 0
    names = opened.run(
        "[...document.getElementById('pick-ads').options].map((option) => option.textContent)"
    )
    assert names[1].startswith("</script><img src=x")


@needs_chromium
@pytest.mark.parametrize("most", [3, in_campaign(99)])
def test_a_case_of_every_kind_can_be_shown(opened, evaluation, most):
    kinds = {(case.status, case.zone): case.case for case in evaluation.cases}
    for key in [*kinds.values()][:most]:
        look_at(opened, key)
        opened.run("new Promise((resolve) => setTimeout(resolve, 0))")
    crashed = next(case for case in evaluation.cases if case.status == "crashed")
    look_at(opened, crashed.case)
    opened.wait("document.getElementById('case-error').textContent.includes('exit code -11')")
    assert opened.run("document.getElementById('case-charts').hidden")


@needs_chromium
def test_play_at_a_contact_begins_at_the_start(opened):
    """Times of a trajectory are rounded to 1 ms, that of the contact is not."""
    opened.run("""(() => {
        const drive = (x) => ({ time: [0, 1], x: [x, x + 9], y: [0, 0], heading: [0, 0],
            speed: [9, 9], acceleration: [0, 0], steering_wheel_angle: [0, 0], length: 4, width: 2 });
        const contact = { time: 0.9996, last: null, other: "lead", side: "front", speed: 9 };
        const road = { end: 100, left: 5, right: -2, lanes: 2, laneWidth: 3.5, crossings: [],
            solid: [], gone: [], line: [] };
        window.root = document.body.appendChild(document.createElement("div"));
        window.small = sumoReplay.player(root);
        small.show({ road, bodies: {}, ghosts: [],
            views: [{ name: "a", ego: drive(0), actors: [["lead", drive(13)]], contact }] });
        root.querySelector(".replay-play").click();
        // in every picture: on a busy machine a look from outside comes after the end
        window.least = 1;
        (function look() {
            least = Math.min(least, Number(root.querySelector(".replay-slider").value));
            if (root.isConnected) requestAnimationFrame(look);
        })();
    })()""")
    opened.wait("least < 0.9")
    opened.run("small.stop(); root.remove()")


@needs_chromium
@pytest.mark.parametrize("curvature", [0.0, 0.01])
def test_names_in_the_picture_of_a_contact_are_whole(opened, curvature):
    """The contact may be up to half a millisecond after the last sample of the struck body. Names
    are inside the picture and apart, also where its left edge is near.
    """
    line = [[0.0, 0.0, 0.0, 0.0, curvature, 0.0]] if curvature else []
    names = opened.run(f"""(() => {{
        const drive = (x, length) => ({{ time: [0, 1], x: [x, x + 19], y: [0, 0], heading: [0, 0],
            speed: [19, 19], acceleration: [0, 0], steering_wheel_angle: [0, 0], length, width: 2 }});
        const contact = {{ time: 1.0004, last: 0, other: "adult", side: "front", speed: 19 }};
        const road = {{ end: 100, left: 5, right: -2, lanes: 2, laneWidth: 3.5, crossings: [],
            solid: [], gone: [], line: {json.dumps(line)} }};
        const canvas = document.body.appendChild(document.createElement("canvas"));
        const sheet = CanvasRenderingContext2D.prototype, write = sheet.fillText, names = [];
        canvas.style = "width: 330px; height: 96px";
        sheet.fillText = function (words, x, y) {{
            const half = this.measureText(words).width / 2;
            names.push([words, x - half, x + half, y, this.textAlign]);
        }};
        sumoReplay.moment(canvas, {{ road, bodies: {{}}, ghosts: [] }},
            {{ ego: drive(0, 4), actors: [["adult", drive(3, 0.5)]], contact }}, "#000", contact.time);
        sheet.fillText = write;
        canvas.remove();
        return names.filter(([words]) => !words.endsWith(" m"));
    }})()""")
    assert {words for words, *_ in names} == {"ego", "adult", "last moment to brake"}
    for words, left, right, y, align in names:
        assert (align, left >= 0.0, right <= 330.0, 9.0 <= y <= 96.0) == ("center", *3 * [True])
        others = [other for other in names if other[0] != words]
        assert all(right < a or left > b or abs(y - c) >= 10.0 for _, a, b, c, _ in others)


@needs_chromium
def test_a_case_that_the_page_lacks_is_said_to_be_elsewhere(opened):
    absent = "document.getElementById('case-absent')"
    for key in ("nowhere", "50%"):
        opened.run(f"(location.hash = '#case:{key}', null)")
        opened.wait(f"{absent}.textContent.includes({json.dumps(f'The case {key} is')})")
        assert "sumo-eval replay" in opened.run(f"{absent}.textContent")
        assert not opened.run(f"{absent}.hidden")
    opened.run("(location.hash = '', null)")
    opened.wait(f"{absent}.hidden")


@needs_chromium
def test_choosing_another_ads_keeps_the_point(opened, evaluation):
    case = pick(evaluation, collided=True)
    look_at(opened, case.case)
    words = ", ".join(f"{name} {value:g}" for name, value in case.values.items())
    opened.wait(
        f"document.getElementById('case-name').textContent === {json.dumps(f'calm: {words}')}"
    )
    opened.run(
        "const pick = document.getElementById('pick-ads'); pick.value = '1'; "
        "pick.dispatchEvent(new Event('change'))"
    )
    opened.wait(
        f"document.getElementById('case-name').textContent.endsWith({json.dumps(f': {words}')})"
    )
    assert opened.run("document.getElementById('case-name').textContent").startswith("</script>")


@needs_chromium
def test_a_click_on_the_map_shows_the_case(opened):
    # a case that was just shown still scrolls, and draws its charts
    opened.run("""(async () => {
        for (let last = null, at; last !== (at = document.body.getBoundingClientRect().y); last = at)
            await new Promise((resolve) => setTimeout(resolve, 300));
    })()""")
    place = opened.run("""(() => {
        const plot = document.querySelector('[data-map="0"] .plot');
        plot.scrollIntoView({ block: 'center' });
        const trace = plot.data.find((one) => one.name === 'no contact');
        const box = plot.getBoundingClientRect(), layout = plot._fullLayout;
        return { x: box.x + layout.xaxis._offset + layout.xaxis.d2p(trace.x.at(-1)),
                 y: box.y + layout.yaxis._offset + layout.yaxis.d2p(trace.y.at(-1)), index: trace.customdata.at(-1) };
    })()""")
    for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
        button = "none" if kind == "mouseMoved" else "left"
        opened.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=place["x"],
            y=place["y"],
            button=button,
            clickCount=1,
        )
        opened.run("new Promise((resolve) => setTimeout(resolve, 120))")
    opened.wait(f"document.getElementById('pick-case').value === '{place['index']}'")
    assert opened.run("document.getElementById('pick-scenario').value") == "0"


@needs_chromium
def test_the_preventability_map_shows_the_verdicts_of_the_chosen_ads(opened, evaluation):
    for which, scenario in enumerate(SCENARIOS):
        for position, ads in enumerate((CALM, HOSTILE)):
            letters = opened.run(f"""(() => {{
                const card = document.querySelector('[data-prevented="{which}"]');
                card.querySelectorAll('input')[{position}].click();
                const traces = [...card.querySelectorAll('.plot')].map((plot) => plot.data[0]);
                return traces.flatMap((trace) => (trace.type === 'heatmap' ? trace.z.flat() : trace.marker.color))
                    .filter((z) => z !== null).map((z) => Math.floor(z));
            }})()""")
            judged = list(verdicts(evaluation, evaluation.score(ads, scenario)))
            assert sorted(letters) == sorted(map(list(LOOKS).index, judged))


@needs_chromium
def test_the_case_panel_tells_the_criticality_measures_in_words(opened, evaluation):
    case = [case for case in evaluation.cases if case.ads == CALM and case.collided][-1]
    look_at(opened, case.case)
    opened.wait(
        "document.getElementById('case-facts').textContent.includes('delta-v at "
        "contact-3.75\u00a0m/s')"
    )
    text = opened.run("document.getElementById('case-facts').textContent")
    assert "smallest gap ahead0.00\u00a0m" in text
    assert "largest inverse TTC" not in text, "it has no bound at contact"
    place = list(evaluation.cases_of(case.ads, case.scenario)).index(case)
    judged = verdicts(evaluation, evaluation.score(case.ads, case.scenario))[place]
    assert f"verdict{LOOKS[str(judged)].words}" in text


@needs_chromium
def test_the_case_panel_has_every_factor_of_h(opened, evaluation):
    case = next(case for case in evaluation.cases if case.human_likeness)
    look_at(opened, case.case)
    opened.wait(
        "document.getElementById('case-facts').textContent.includes('length factor in H"
        f"{case.likeness_length_factor:.3f}')"
    )


@pytest.mark.campaign
@needs_chromium
def test_more_than_three_parameters_are_slices_to_choose(report, tmp_path):
    """The page of the other tests with a fifth of its cases moved to a second value of two more
    parameters."""
    text = report.read_text()
    data = json.loads(unpacked(text, "report-data"))
    scenario = data["scenarios"][0]
    for name, values in (("extra", (1.0, 2.0)), ("other", (3.0, 4.0))):
        scenario["parameters"].append(
            {"name": name, "unit": "m", "low": values[0], "high": values[1], "about": ""}
        )
        for number, case in enumerate(scenario["cases"]):
            case["values"].append(values[number % 5 == 0])
    scenario["view"]["slice"] = {"2": 1.0, "3": 3.0}
    page = with_packed(text, "report-data", json.dumps(data))
    scenario["lattice"] = None  # that of the two parameters it had
    page = with_packed(text, "report-data", json.dumps(data))
    (tmp_path / "slices.html").write_text(page)
    own = [case for case in scenario["cases"] if case["ads"] == CALM]
    moved = [case for case in own if case["values"][2] == 2.0]
    card = """document.querySelector('[data-prevented="0"]')"""
    with Page(tmp_path / "profile") as opened:
        opened.open(
            (tmp_path / "slices.html").as_uri(),
            "document.documentElement.dataset.report === 'ready'",
        )
        opened.run(
            "document.querySelectorAll('details.fold').forEach((fold) => { fold.open = true; })"
        )
        opened.wait(
            f"{card}.querySelectorAll('.slider').length === 2 && {card}.querySelector('.plot').data"
        )
        shown = f"""(() => {{ const data = {card}.querySelector('.plot').data[0];
            return (data.type === 'heatmap' ? data.z.flat().filter((z) => z !== null) : data.x).length; }})()"""
        assert opened.run(shown) == len(own) - len(moved)
        opened.run(f"""{card}.querySelectorAll('.slider input').forEach((slider) => {{
            slider.value = 1; slider.dispatchEvent(new Event('input', {{ bubbles: true }})); }})""")
        assert opened.run(shown) == len(moved)
        assert f"{len(moved)} of {len(own)} cases" in opened.run(
            f"{card}.querySelector('.slice-note').textContent"
        )
        opened.run(f"""{card}.querySelectorAll('.slider select').forEach((select) => {{
            select.value = 'all'; select.dispatchEvent(new Event('change')); }})""")
        assert opened.run(shown) == len(own)
        opened.run(f"""(() => {{ const axis = {card}.querySelector('[data-axis=x]');
            axis.value = '2'; axis.dispatchEvent(new Event('change')); }})()""")
        assert opened.run(f"{card}.querySelector('.plot').layout.xaxis.title.text") == "extra, m"
        assert opened.problems == []


@needs_chromium
def test_on_a_slice_of_ones_own_what_cannot_be_is_hatched_up_to_its_limit_and_holds_no_case(opened):
    card = f"""document.querySelector('[data-map="{SCENARIOS.index("front_vehicle_cut_out")}"]')"""
    pick = f"""(which, value) => {{ const axis = {card}.querySelector(`[data-axis=${{which}}]`);
        axis.value = value; axis.dispatchEvent(new Event('change')); }}"""
    opened.run(f"{card}.scrollIntoView()")
    opened.wait(f"{card}.querySelector('.plot')?.data")
    opened.run(
        f"(() => {{ const pick = {pick}; pick('panel', ''); pick('x', 0); pick('y', 1); }})()"
    )
    slider = f"{card}.querySelector('.slider input')"
    opened.run(
        f"(() => {{ {slider}.value = 0; {slider}.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    )
    traces = opened.run(f"""[...{card}.querySelector('.plot').data].filter((trace) => trace.type === 'scatter')
        .map(({{ x, y, name, fillpattern }}) => ({{ x, y, name, pattern: fillpattern?.shape }}))""")
    opened.run(
        f"(() => {{ const pick = {pick}; pick('x', 1); pick('y', 2); pick('panel', 0); }})()"
    )
    (hatched,) = [trace for trace in traces if trace.get("pattern") == "/"]
    corners = [(x, y) for x, y in zip(hatched["x"], hatched["y"], strict=True) if x is not None]
    # gap = 20 m: slower than the ego, and 6.5 m + 1.3 s * (ego_speed - obstacle_speed) <= gap
    slower = [x - y for x, y in corners]
    assert all(d <= 1e-2 or d >= (20.0 - 6.5) / 1.3 - 1e-2 for d in slower)
    assert min(abs(d) for d in slower) < 1e-2
    assert min(abs(d - (20.0 - 6.5) / 1.3) for d in slower) < 1e-2
    cases = [(x, y) for trace in traces if trace.get("name") in ("no contact", "collision")
             for x, y in zip(trace["x"], trace["y"], strict=True)]  # fmt: skip
    assert cases
    assert all(1e-2 < x - y < (20.0 - 6.5) / 1.3 for x, y in cases)


@needs_chromium
def test_a_second_ads_stands_beside_the_first_and_the_filter_holds_for_both(opened, evaluation):
    card = """document.querySelector('[data-map="1"]')"""
    opened.run(f"""(() => {{ const beside = {card}.querySelector('[data-beside]');
        beside.selectedIndex = 1; beside.dispatchEvent(new Event('change')); }})()""")
    assert opened.run(f"{card}.querySelectorAll('.beside > div').length") == 2
    opened.run(f"""(() => {{ const by = {card}.querySelector('[data-by=outcome]');
        by.value = 'collision'; by.dispatchEvent(new Event('change')); }})()""")
    hits = [case for case in evaluation.cases if case.scenario == CUT_OUT and case.collided]
    drawn = f"""[...{card}.querySelectorAll('.plot')].flatMap((plot) => plot.data)
        .filter((trace) => ['no contact', 'collision', 'off road', 'not evaluated'].includes(trace.name))
        .flatMap((trace) => trace.x).length"""
    assert opened.run(drawn) == len(hits)
    opened.run(f"{card}.querySelector('[data-cases]').open = true")
    opened.wait(f"{card}.querySelectorAll('.case-list tbody tr').length === {min(15, len(hits))}")
    listed = f"[...{card}.querySelectorAll('.case-list .case-id')].map((link) => link.textContent)"
    assert set(opened.run(listed)) <= {case.case for case in hits}
    clear = (
        f"[...{card}.querySelectorAll('button')].find((one) => one.textContent === 'Clear').click()"
    )
    opened.run(clear)
    own = [case for case in evaluation.cases if case.scenario == CUT_OUT]
    safe = [case for case in own if case.zone == "safe"]
    opened.run(f"""(() => {{ const by = {card}.querySelector('[data-by=zone]');
        by.value = 'safe'; by.dispatchEvent(new Event('change')); }})()""")
    assert opened.run(drawn) == len(safe) < len(own)
    name, limit = (
        next(iter(own[0].values)),
        sorted(case.values[next(iter(case.values))] for case in safe)[len(safe) // 2],
    )
    opened.run(f"""(() => {{ const least = {card}.querySelector('[data-range="{name} least"]');
        least.value = {limit!r}; least.dispatchEvent(new Event('change')); }})()""")
    assert opened.run(drawn) == sum(case.values[name] >= limit for case in safe) < len(safe)
    opened.run(clear)
    opened.run(f"""(() => {{ const words = {card}.querySelector('[type=search]');
        words.value = {json.dumps(own[0].case)}; words.dispatchEvent(new Event('input')); }})()""")
    assert opened.run(drawn) == 1
    assert opened.run(listed) == [own[0].case]
    opened.run(f"{card}.querySelector('[data-groups] li button').click()")
    assert opened.run(drawn) > 0, "a group is shown whatever was filtered before"
    assert opened.run(f"{card}.querySelector('[type=search]').value") == ""
    opened.run(clear)
    opened.run(f"{card}.querySelector('input[data-ads]').click()")


@pytest.mark.campaign
@needs_chromium
def test_every_word_can_be_read_in_the_light_and_in_the_dark(opened):
    for theme in ("Dark", "Light"):
        opened.run(
            "[...document.querySelectorAll('[data-tools] button')].find((b) => b.textContent === "
            f"'{theme}').click()"
        )
        assert opened.run("document.documentElement.dataset.theme") == theme.lower()
        assert opened.run(CONTRAST) == []
        written = opened.run(WRITTEN_IN_CELLS)
        assert written
        assert min(written) >= 4.5


@needs_chromium
def test_every_chart_can_be_saved(opened):
    charts = "[...document.querySelectorAll('.js-plotly-plot')].filter((plot) => plot.clientWidth)"
    assert opened.run(
        f"{charts}.every((plot) => plot.closest('figure, .panel').querySelectorAll('.save "
        "button').length === 3)"
    )
    opened.run("""window.saved = [];
        URL.createObjectURL = (blob) => { blob.text()
            .then((text) => window.saved.push(text)); return '#'; };
        HTMLAnchorElement.prototype.click = function () {}; null""")
    opened.run(
        "document.querySelectorAll('[data-map=\"0\"] .save button')"
        ".forEach((b, k) => { if (k === 0 || k === 2) b.click(); })"
    )
    opened.wait("window.saved.length === 2")
    saved = opened.run("window.saved.sort()")
    assert any(text.startswith("<svg") for text in saved)
    assert any(text.startswith("series,case,x,y,value\r\n") and CALM in text for text in saved)
    opened.run("window.saved = []; document.getElementById('plot-speed').closest('figure')"
               ".querySelector('.save').lastElementChild.click()")  # fmt: skip
    opened.wait("window.saved.length === 1")
    rows = opened.run("window.saved[0]").strip().split("\r\n")[1:]  # a name may have U+2028
    shown = opened.run("document.getElementById('legend-ads').textContent")
    drivers = not opened.run("document.getElementById('legend-drivers').hidden")
    names = {row.split(",")[0].strip('"') for row in rows}
    assert "" not in names
    assert drivers == ("drivers" in names)
    assert any(name.startswith(shown[:5]) for name in names)


@needs_chromium
def test_a_copy_button_keeps_its_words_when_clicked_twice(opened):
    copy = "document.querySelector('[data-copy]')"
    before = opened.run(f"{copy}.textContent")
    opened.run(f"{copy}.click(); setTimeout(() => {copy}.click(), 200); null")
    opened.run("new Promise((resolve) => setTimeout(resolve, 1800))")
    assert opened.run(f"{copy}.textContent") == before == "copy"


@pytest.mark.campaign
@needs_chromium
def test_the_replay_plays_beside_another_ads_and_printing_redraws(opened, evaluation):
    case = pick(evaluation, collided=True)
    opened.run(
        "(location.hash = '', location.hash = '#case:' + "
        f"encodeURIComponent({json.dumps(case.case)}), null)"
    )
    opened.wait("document.querySelector('.replay-reading')?.textContent.includes('contact at')")
    opened.run("""(() => { const beside = document.getElementById('replay-beside');
        beside.value = '0'; beside.dispatchEvent(new Event('change')); })()""")
    assert opened.run("document.querySelectorAll('.replay-chase').length") == 2
    opened.run("document.querySelector('.replay-play').click()")
    opened.run("new Promise((resolve) => setTimeout(resolve, 300))")
    opened.run("document.querySelector('details.fold').open = false")
    opened.run("window.dispatchEvent(new Event('beforeprint'))")
    assert opened.run(
        "[...document.querySelectorAll('details.fold')].every((fold) => fold.open)"
    ), "paper has it all"
    widths = opened.run(
        "[...document.querySelectorAll('.js-plotly-plot')].map((plot) => plot._fullLayout.width)"
    )
    assert max(widths) <= 690
    opened.run("window.dispatchEvent(new Event('afterprint'))")
    assert not opened.run("document.querySelector('details.fold').open")
    opened.run("document.querySelector('details.fold').open = true")


@needs_chromium
def test_keys_alone_unfold_sections_change_the_case_and_are_seen_where_they_are(opened):
    fold = "document.querySelector('details.fold')"
    opened.run(f"({fold}.open = false, document.querySelector('.skip').focus(), null)")
    for _ in range(60):
        press(opened, "Tab")
        if opened.run(f"document.activeElement === {fold}.querySelector('summary')"):
            break
    else:
        pytest.fail("the first section cannot be reached by Tab")
    assert opened.run("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    press(opened, "Enter")
    opened.wait(f"{fold}.open")
    opened.run("document.getElementById('pick-case').focus()")
    before = opened.run("location.hash + document.getElementById('case-name').textContent")
    # Another test may have left the page at the last case, below which there is none.
    last = opened.run(
        "(({ selectedIndex, length }) => selectedIndex === length - 1)(document.activeElement)"
    )
    press(opened, "ArrowUp" if last else "ArrowDown")
    opened.wait(
        f"location.hash + document.getElementById('case-name').textContent !== {json.dumps(before)}"
    )
    by_mouse_alone = """[...document.querySelectorAll('body *')].filter((one) => one.getClientRects().length
        && getComputedStyle(one).cursor === 'pointer' && !one.closest('a, button, summary, label, select, input, svg'))
        .map((one) => one.className)"""
    assert opened.run(by_mouse_alone) == []


@needs_chromium
def test_the_terms_of_c_are_the_numbers_of_the_table(opened, evaluation):
    for which, scenario in enumerate(SCENARIOS):
        hits = [case for case in evaluation.cases if case.scenario == scenario and case.collided]
        if not hits:
            assert opened.run(f"document.querySelector('[data-terms=\"{which}\"]')") is None
            continue
        ads = next(
            score.ads
            for score in evaluation.scores
            if score.scenario == scenario and score.collisions
        )
        cases = [case for case in evaluation.cases if (case.scenario, case.ads) == (scenario, ads)]
        # U belongs to collisions; r is the weight of every point in A, and of the collisions in C
        for term, numbers in (
            ("severity", [case.severity for case in hits if case.ads == ads]),
            ("weight", [case.weight for case in cases if case.weight is not None]),
        ):
            radio = f'[data-terms="{which}"] input[name^=term-][value={term}]'
            opened.run(f"document.querySelectorAll('{radio}')[0].click()")
            shown = opened.run(f"""[...document.querySelectorAll('[data-terms="{which}"] .panels .plot')]
                .map((plot) => plot.data[0])
                .flatMap((trace) => (trace.type === 'heatmap' ? trace.z.flat() : trace.marker.color))
                .filter((z) => z !== null)""")
            assert sorted(shown) == pytest.approx(sorted(numbers)), term


@needs_chromium
@pytest.mark.parametrize("width", [390, 1280, 1400, in_campaign(2560)])
def test_no_page_is_wider_than_its_window(opened, width):
    size(opened, width, 800)
    # charts follow the window a little later
    opened.wait(f"document.documentElement.scrollWidth <= {width}", 20.0)
    cut = """[...document.querySelectorAll('.scroll, .overflow')].filter((one) => one.scrollWidth > one.clientWidth + 1)
        .map((one) => one.textContent.trim().slice(0, 60))"""
    assert width < 1280 or opened.run(cut) == [], "no table hides its last column"
    opened.call("Emulation.clearDeviceMetricsOverride")
