"""Check circles of imports, unused names, docstrings, style, and words of pages and commits.

    python tools/house_check.py            every finding that is not allowed, one a line; exit status 1 if there is one
    python tools/house_check.py --facts    also lines, files and loose files at the top
    python tools/house_check.py --words    also every place that a pattern of house_words.toml finds

An import counts wherever it stands, within a function too: a circle that only works because one
side imports late is a circle. Code is alive when the package, the tools, the documentation or its
examples name it; tests do not keep it alive. tools/house_allowances.toml has what is allowed all
the same, each with its reason; an allowance that nothing needs is a finding itself.
tools/house_words.toml has the limits of words; its counts may only fall.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping
from pathlib import Path

from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

PACKAGE = "sumo_eval"
ALLOWANCES = Path("tools") / "house_allowances.toml"
WORDS = Path("tools") / "house_words.toml"
LEANING = re.compile(r"(The same\b|As `|Like )")
"""How a docstring begins that says nothing to somebody who has not read another one."""

_TEXTS = {".j2", ".js", ".toml"}  # within the package: templates and data that may name code
_ENTRIES = ("__main__", "__init__")
_CODE = re.compile(r"```.*?```|`[^`\n]+`", flags=re.S)
_WORD = re.compile(r"[A-Za-z_]\w*")
_LAYOUT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip
_LONG_LINE = re.compile(r"^.{161,}$", re.M)
_LONG_TEST = re.compile(r"^ *def test_\w{56,}", re.M)

Trees = Mapping[str, ast.Module]
Graph = Mapping[str, frozenset[str]]


def trees_of(root: Path, package: str = PACKAGE) -> dict[str, ast.Module]:
    """Every module of the package, by its dotted name."""
    found = {}
    for path in sorted((root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"), str(path))
    return found


def import_graph(trees: Trees) -> dict[str, frozenset[str]]:
    """Which modules of the package each of them imports, wherever in it the import stands."""
    graph = {}
    for name, tree in trees.items():
        found: set[str] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                found |= (inner & trees.keys()) or {node.module}
        graph[name] = frozenset(found & trees.keys()) - {name}
    return graph


def users(trees: Trees) -> dict[str, set[str]]:
    """By module: paths of those that import it, or a name of it by way of a package; not packages
    that hold it.
    """
    packages = {name.rpartition(".")[0] for name in trees}
    found: dict[str, set[str]] = {name: set() for name in trees.keys() - packages}
    imports = [
        (name, node.module, alias.name)
        for name, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]
    homes = {(name, what): source for name, source, what in imports if name in packages}
    for name, source, what in imports:
        home = f"{source}.{what}"
        home = home if home in trees else homes.get((source, what), source)
        if home in found and not (name in packages and home.startswith(f"{name}.")):
            inner = "/__init__" if name in packages else ""
            found[home].add(name.partition(".")[2].replace(".", "/") + inner)
    return found


def users_not_named(trees: Trees) -> Iterator[str]:
    """Modules, each with a user that its docstring, if any, names neither by file nor by room."""
    for module, paths in sorted(users(trees).items()):
        docstring = ast.get_docstring(trees[module]) or ""
        for path in sorted(paths) if docstring else ():
            *rooms, stem = path.split("/")
            above = ["/".join(rooms[:depth]) + "/" for depth in range(1, len(rooms) + 1)]
            ways = path, path.replace("/", "."), stem, f"{stem}.py", f"{path}.py", *above
            if not any(f"`{way}`" in docstring for way in ways):
                yield f"{module}: {path}.py"


def circles(graph: Graph) -> list[list[str]]:
    """Groups of modules of which each reaches every other one by imports."""
    names = sorted(graph)
    links = csr_array([[int(other in graph[name]) for other in names] for name in names])
    groups: dict[int, list[str]] = {}
    for name, number in zip(
        names, connected_components(links, connection="strong")[1], strict=True
    ):
        groups.setdefault(int(number), []).append(name)
    return sorted(group for group in groups.values() if len(group) > 1)


def defined(tree: ast.Module) -> Iterator[str]:
    """Functions, classes and constants at the top of a module; what a decorator hands to somebody
    else is not asked.
    """
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            if not any(_registers(decorator) for decorator in node.decorator_list):
                yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def _registers(decorator: ast.expr) -> bool:
    """Whether a decorator is one of click's, which puts the function into a command line."""
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(called, ast.Attribute) and called.attr in ("command", "group")


def used(tree: ast.Module) -> set[str]:
    """Names that a module reads or imports, and the words of its texts, except docstrings."""
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            found.add(node.id)
        elif isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.alias):
            found |= {node.name, *node.name.split(".")}
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose
        ):
            found |= set(_WORD.findall(node.value))
    return found


def named_outside(root: Path, package: str = PACKAGE) -> set[str]:
    """Names in the tools, the documentation's examples and code spans, and the package's templates
    and data files.
    """
    found: set[str] = set()
    for path in (path for folder in ("tools", "docs") for path in (root / folder).rglob("*.py")):
        found |= used(ast.parse(path.read_text(encoding="utf-8"), str(path)))
    for path in (*root.glob("*.md"), *(root / "docs").rglob("*.md")):
        if path.name != "CHANGELOG.md":
            spans = _CODE.findall(path.read_text(encoding="utf-8"))
            found |= {word for span in spans for word in _WORD.findall(span)}
    for path in (path for path in (root / package).rglob("*") if path.suffix in _TEXTS):
        found |= set(_WORD.findall(path.read_text(encoding="utf-8")))
    return found | set(_WORD.findall((root / "pyproject.toml").read_text(encoding="utf-8")))


def dead_names(trees: Trees, outside: set[str]) -> list[str]:
    """Names at the top of a module, as `module.name`, that nothing but tests uses."""
    alive = outside.union(*(used(tree) for tree in trees.values()))
    return [
        f"{module}.{name}"
        for module, tree in trees.items()
        for name in defined(tree)
        if name not in alive and not (name.startswith("__") and name.endswith("__"))
    ]


def dead_modules(trees: Trees, graph: Graph, outside: set[str]) -> list[str]:
    """Modules that nothing imports and no text names: the way in of a command or of a process is
    named somewhere.
    """
    imported = set().union(*graph.values())
    texts = "\n".join(
        node.value
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    packages = {name.rpartition(".")[0] for name in trees}
    return [
        name
        for name in trees
        if name not in imported | packages
        and name.rpartition(".")[2] not in (*_ENTRIES, *outside)
        and name not in texts
    ]


def leaning_docstrings(trees: Trees) -> list[str]:
    """Modules, classes and functions, as `module.name`, whose docstring begins by pointing at
    another one.
    """
    found = []
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(
                node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
            ) and LEANING.match(ast.get_docstring(node) or ""):
                found.append(module if isinstance(node, ast.Module) else f"{module}.{node.name}")
    return found


def findings(root: Path, package: str = PACKAGE) -> list[str]:
    """Everything that is wrong with the house, allowed or not, each once, by a name that does not
    move with lines.
    """
    trees = trees_of(root, package)
    graph = import_graph(trees)
    outside = named_outside(root, package)
    tools = {
        f"tools.{path.stem}": ast.parse(path.read_text(encoding="utf-8"))
        for path in (root / "tools").glob("*.py")
    }
    found = [f"circle: {' '.join(group)}" for group in circles(graph)]
    found += [f"dead module: {name}" for name in dead_modules(trees, graph, outside)]
    found += [f"dead: {name}" for name in dead_names(trees, outside)]
    found += [f"user not named in a docstring: {name}" for name in users_not_named(trees)]
    found += [f"docstring: {name}" for name in leaning_docstrings({**trees, **tools})]
    return list(dict.fromkeys(found))


def allowances(root: Path) -> dict[str, str]:
    """What is allowed, with its reason. A missing file allows nothing."""
    path = root / ALLOWANCES
    content = tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    allowed: dict[str, str] = content.get("allowed", {})
    return allowed


def judged(found: list[str], allowed: Mapping[str, str]) -> list[str]:
    """What is to be mended: findings without an allowance, allowances without a finding or without
    a reason.
    """
    wrong = [one for one in found if one not in allowed]
    wrong += [f"allowance that nothing needs: {one}" for one in allowed if one not in found]
    return wrong + [
        f"allowance without a reason: {one}"
        for one, reason in allowed.items()
        if not reason.strip()
    ]


def wording(root: Path, package: str = PACKAGE) -> tuple[list[str], list[str]]:
    """What is wrong with words, and every place that a pattern of tools/house_words.toml finds."""
    path = root / WORDS
    if not path.is_file():
        return [], []
    limits = tomllib.loads(path.read_text(encoding="utf-8"))
    menu = (root / "mkdocs.yml").read_text(encoding="utf-8")
    pattern = re.compile("|".join(limits["patterns"]), re.M)
    places: dict[str, list[str]] = {name: [] for name in limits["most"]}
    wrong: list[str] = []

    def seek(kind: str, place: str, text: str, sought: re.Pattern[str] = pattern) -> None:
        for allowed in limits["allowed"]:
            text = text.replace(allowed, "")
        places[kind] += [f"{kind}: {place}: {hit[0].strip()}" for hit in sought.finditer(text)]

    for page in (*root.glob("*.md"), *(root / "docs").rglob("*.md")):
        name, text = page.relative_to(root).as_posix(), page.read_text(encoding="utf-8")
        places["words"] += text.split()
        most = limits["pages"].get(name, limits["page"])
        if len(text.split()) > most:
            wrong.append(f"words: {name} must have at most {most}, has {len(text.split())}")
        if name.removeprefix("docs/") not in menu and name.startswith("docs/"):
            wrong.append(f"menu: {name} is not in mkdocs.yml")
        seek("long lines", name, text, _LONG_LINE)
        if name != "CHANGELOG.md":
            seek("English of pages", name, _CODE.sub("", text))
    for module, tree in trees_of(root, package).items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                seek("English of the package", f"{module}:{node.lineno}", node.value)
    for kind, place in style(root, package):
        places.setdefault(kind, []).append(f"{kind}: {place}")
    for test in (root / "tests").rglob("*.py"):
        seek("long test names", test.name, test.read_text(encoding="utf-8"), _LONG_TEST)
    for kind, most in limits["most"].items():
        if len(places[kind]) > most:
            wrong.append(
                f"{kind}: must be at most {most}, are {len(places[kind])} (--words lists them)"
            )
    log = ["git", "log", "--no-merges", "--format=%s", f"--since={limits['since']}"]
    subjects = subprocess.run(
        log, cwd=root, capture_output=True, text=True, check=False
    ).stdout.splitlines()
    wrong += [f"subject over 60 characters: {subject}" for subject in subjects if len(subject) > 60]
    return wrong, [hit for kind, hits in places.items() if kind != "words" for hit in hits]


def style(root: Path, package: str = PACKAGE) -> Iterator[tuple[str, str]]:
    """What is longer than a reader can hold: its kind and its place."""
    for path in sorted((root / package).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        rows = [token.start[0] for token in tokens if token.type not in _LAYOUT]
        for row, line in enumerate(text.splitlines(), 1):
            if len(line) > 100:
                yield "lines over 100 characters", f"{path}:{row}"
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                place, given = f"{path}:{node.lineno} {node.name}", node.args
                if bisect_right(rows, node.end_lineno or 0) - bisect_left(rows, node.lineno) > 150:
                    yield "functions over 150 tokens", place
                names = {one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)}
                command = any("click" in ast.unparse(it) for it in node.decorator_list)
                if len(names - {"self", "cls"}) > 7 and not command:
                    yield "functions over 7 parameters", place
            elif isinstance(node, ast.Assign) and any(
                isinstance(target, ast.Tuple) and len(target.elts) > 3 for target in node.targets
            ):
                yield "assignments over 3 targets", f"{path}:{node.lineno}"


def facts(root: Path, package: str = PACKAGE) -> str:
    """Size of the house in a line."""
    paths = list((root / package).rglob("*.py"))
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
    loose = sum(path.parent == root / package for path in paths)
    return f"{lines} lines in {len(paths)} files, {loose} of them loose at the top"


def main(arguments: list[str] | None = None) -> int:
    """Print what is to be mended."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).parents[1], help="the project's folder"
    )
    parser.add_argument("--facts", action="store_true", help="also print the size of the house")
    parser.add_argument(
        "--words", action="store_true", help="also list what the patterns of words find"
    )
    given = parser.parse_args(arguments)
    found = findings(given.root)
    if given.facts:
        print(facts(given.root))
    wrong, places = wording(given.root)
    wrong += judged(found, allowances(given.root))
    if given.words:
        print(*places, sep="\n")
    if wrong:
        print(*wrong, sep="\n")
        print(
            f"{len(wrong)} to mend; what must stay needs a line with its reason in {ALLOWANCES}.",
            file=sys.stderr,
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
