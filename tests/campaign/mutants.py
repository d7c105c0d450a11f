"""Evaluation files that somebody broke: wrong types, unknown keys, nan, negative, huge, truncated,
binary."""

import copy
import random
import tomllib

import tomli_w

BASE = tomllib.loads("""
name = "mutant"
seed = 3
scenario = [{ use = "front_vehicle_low_speed", sampling = { method = "grid", levels = 2 } }]
ads = [{ name = "idm", controller = "idm" }]
drivers = { count = 2, source = "synthetic" }
[run]
workers = 2
case_timeout = 20.0
step_timeout = 1.0
memory_limit = 4096.0
cases_per_child = 50
engine = "processes"
incomplete = "shown"
[simulation]
step = 0.05
time_limit = 60.0
vehicle = { max_deceleration = 9.0, wheelbase = 2.7 }
[method]
score = { a = 50.0, k5 = 1.0 }
zones = { deceleration = 5.0, critical_inverse_ttc = 0.7 }
anthropomorphic = { centre_deviation_floor = 0.15, field = { k1 = 0.5, k2 = 0.005 } }
collision = { loss = "severity" }
[report]
reference = "careful_driver"
""")

SCENARIO = tomllib.loads("""
name = "own"
parameter = [{ name = "v", unit = "m/s", low = 8.0, high = 14.0, step = 6.0 }]
road = { network = "own.net.xml", edges = ["m"] }
end = { x = 280.0 }
ego = { x = 10.0, speed = "v" }
vehicle = [{ name = "lead", gap = 40.0, speed = 4.0 }]
zone = { obstacle = "lead" }
""")
UNITS = (
    "km/h",
    "m",
    "mph",
    "m/s2",
    "1",
    "knots",
    "s",
    "30 km/h",
    "v km/h",
    "v / 3.6",
    "90 kph",
    "é",
    "v m/s",
)
LANES = (
    'allow="pedestrian"', 'allow="bicycle"', 'disallow="all"', 'disallow="passenger"',
    'allow="bus"', "", 'width="3.5"',
    'allow="all"', 'width="2" allow="pedestrian"', 'disallow="pedestrian" width="0"',
)  # fmt: skip
LOCATORS = (
    "exec:python {}.py", "traci:python '{}.py'", "exec:{}", "fmu:{}.fmu", "onnx:{}.onnx",
    "sumo:{}", "{}.py:Mine",
    "{}:Mine", "given:{}.py", "exec:python {}.py?period=0.1", "{}.py:Mine?options.a={}",
    "carla:{}.py:A", "{}.toml",
)  # fmt: skip
NAMES = ("a", "a b", "a:b", "é", "中", "a?b", "'", '"', "", "a&b=c", "~", "/x/y", "..", "%41", "-x")

WRONG = (
    "x", "", "🚗", -1, 0, 1, 10**12, 10**30, -0.5, 0.0, 1e-300, 1e300, 0.5, float("nan"),
    float("inf"),
    float("-inf"), True, False, [], [1, "x"], {}, {"x": 1}, "nan", "../../etc/passwd", "a:b",
    "\u0000", " ",
)  # fmt: skip


def mutant(number):
    """The file of that number and what was done to it; the same in every run."""
    draw = random.Random(number)
    content = copy.deepcopy(BASE)
    kind = draw.choice(
        ("value", "value", "value", "value", "key", "missing", "truncated", "binary", "text")
    )
    place, key = draw.choice(list(_places(content)))
    name = f"{kind} at {key}"
    if kind == "value":
        place[key] = draw.choice(WRONG)
        name += f": {place[key]!r}"
    elif kind == "key":
        place[draw.choice((f"{key}s", "x", "", "levles", "a.b", "ключ"))] = draw.choice(WRONG)
    elif kind == "missing":
        del place[key]
    data = tomli_w.dumps(content).encode("utf-8", errors="surrogatepass")
    if kind == "truncated":
        data = data[: draw.randrange(len(data))]
    elif kind == "binary":
        at = draw.randrange(len(data))
        data = data[:at] + draw.randbytes(draw.randrange(1, 200)) + data[at:]
    elif kind == "text":
        at = draw.randrange(len(data))
        text = draw.choice((b"=", b"[", b'"', b"\n", b"#", b"-", b"e", b"nan", b"9" * 40))
        data = data[:at] + text + data[at + 1 :]
    return data, name


def own_inputs(number):
    """Files of somebody's own scenario, a command over them, and what was done: units, lanes,
    tables, locators."""
    draw = random.Random(number)
    content = copy.deepcopy(SCENARIO)
    lanes, header, locator = [""] * 2, "v", "idm"
    kind = draw.choice(("unit", "formula", "lanes", "header", "locator", "table", "end"))
    if kind == "unit":
        content["parameter"][0]["unit"] = draw.choice((*UNITS, *WRONG))
    elif kind == "formula":
        table, key = draw.choice((("ego", "speed"), ("ego", "x"), ("end", "x"), ("road", "edges")))
        content[table][key] = draw.choice((*UNITS, *WRONG))
    elif kind == "lanes":
        lanes = [draw.choice(LANES) for _ in range(draw.randint(0, 4))]
    elif kind == "header":
        header = (
            f"v{draw.choice((' ', ''))}{draw.choice('([')}{draw.choice(UNITS)}{draw.choice(')]')}"
        )
    elif kind == "locator":
        locator = draw.choice(LOCATORS).replace("{}", draw.choice(NAMES))
    elif kind == "table":
        key = draw.choice(list(content))
        value = content[key]
        content[key] = value[0] if isinstance(value, list) else [value]
    else:
        content["end"]["x"] = draw.choice((5.0, 10.0, 11.0, 286.4, 286.5, 1e6))
    shape = "".join(
        f'<lane id="m_{k}" index="{k}" speed="30" length="286.4" {words} shape="0,{3.2 * k:.1f} '
        f'286.4,{3.2 * k:.1f}"/>'
        for k, words in enumerate(lanes)
    )
    junctions = "".join(
        f'<junction id="{name}" type="dead_end" x="0" y="0" shape="0,0 0,9"/>' for name in "ab"
    )
    evaluation = {"name": "own", "scenario": [{"use": "own é.toml"}], "drivers": {"count": 2}}
    if kind == "header":
        evaluation["scenario"][0]["sampling"] = {"method": "file", "file": "points.csv"}
    files = {
        "own é.toml": tomli_w.dumps(content).encode("utf-8", errors="surrogatepass"),
        "own.net.xml": '<net><edge id="m" from="a" '
        f'to="b">{shape}</edge>{junctions}</net>'.encode(),
        "points.csv": f"{header}\n{draw.choice(('36', '10', 'x', '10 m/s'))}\n".encode(),
        "evaluation.toml": tomli_w.dumps(evaluation).encode(),
    }
    command = ["check", "own é.toml"] if kind not in ("header", "locator") else [
        "run", "evaluation.toml", "--dry-run", "--ads", locator]  # fmt: skip
    return files, command, f"{kind}: {content} {lanes} {header!r} {locator!r}"


def _places(content):
    """Every key of the file, with the table it stands in."""
    found = []
    for key, value in content.items():
        found.append((content, key))
        for table in value if isinstance(value, list) else [value]:
            if isinstance(table, dict):
                found += _places(table)
    return found
