"""What the linters do not see: circles of imports, names that nothing uses, docstrings that lean on another one.

    python tools/house_check.py            every finding that is not allowed, one a line; exit status 1 if there is one
    python tools/house_check.py --facts    also lines, files and loose files at the top
    python tools/house_check.py --prune    take allowances out that nothing needs

An import counts wherever it stands, within a function too: a circle that only works because one side imports late is a
circle. Code is alive when the package, the tools, the documentation or its examples name it; tests do not keep it
alive. tools/house_allowances.toml has what is allowed all the same, each with its reason; an allowance that nothing
needs is a finding itself.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

PACKAGE = "sumo_eval"
ALLOWANCES = Path("tools") / "house_allowances.toml"
LEANING = re.compile(r"(The same\b|As `|Like )")
"""How a docstring begins that says nothing to somebody who has not read another one."""

_TEXTS = {".j2", ".js", ".toml"}  # within the package: templates and data that may name code
_ENTRIES = ("__main__", "__init__")
_CODE = re.compile(r"```.*?```|`[^`\n]+`", flags=re.S)
_WORD = re.compile(r"[A-Za-z_]\w*")

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


def circles(graph: Graph) -> list[list[str]]:
    """Groups of modules of which each reaches every other one by imports (Tarjan's strongly connected components)."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    path: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        number[module] = lowest[module] = len(number)
        path.append(module)
        for other in sorted(graph[module]):
            if other not in number:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in path:
                lowest[module] = min(lowest[module], number[other])
        if lowest[module] == number[module]:
            group = path[path.index(module) :]
            del path[path.index(module) :]
            if len(group) > 1:
                found.append(sorted(group))

    for module in graph:
        if module not in number:
            visit(module)
    return sorted(found)


def defined(tree: ast.Module) -> Iterator[str]:
    """Functions, classes and constants at the top of a module; what a decorator hands to somebody else is not asked."""
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
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            found |= set(_WORD.findall(node.value))
    return found


def named_outside(root: Path, package: str = PACKAGE) -> set[str]:
    """Names in the tools, the documentation's examples and code spans, and the package's templates and data files."""
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
    """Modules that nothing imports and no text names: the way in of a command or of a process is named somewhere."""
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
    """Modules, classes and functions, as `module.name`, whose docstring begins by pointing at another one."""
    found = []
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and LEANING.match(
                ast.get_docstring(node) or ""
            ):
                found.append(module if isinstance(node, ast.Module) else f"{module}.{node.name}")
    return found


def findings(root: Path, package: str = PACKAGE) -> list[str]:
    """Everything that is wrong with the house, allowed or not, each once, by a name that does not move with lines."""
    trees = trees_of(root, package)
    graph = import_graph(trees)
    outside = named_outside(root, package)
    tools = {
        f"tools.{path.stem}": ast.parse(path.read_text(encoding="utf-8")) for path in (root / "tools").glob("*.py")
    }
    found = [f"circle: {' '.join(group)}" for group in circles(graph)]
    found += [f"dead module: {name}" for name in dead_modules(trees, graph, outside)]
    found += [f"dead: {name}" for name in dead_names(trees, outside)]
    found += [f"docstring: {name}" for name in leaning_docstrings({**trees, **tools})]
    return list(dict.fromkeys(found))


def allowances(root: Path) -> dict[str, str]:
    """What is allowed, with its reason. A missing file allows nothing."""
    path = root / ALLOWANCES
    content = tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    allowed: dict[str, str] = content.get("allowed", {})
    return allowed


def judged(found: list[str], allowed: Mapping[str, str]) -> list[str]:
    """What is to be mended: findings without an allowance, allowances without a finding or without a reason."""
    wrong = [one for one in found if one not in allowed]
    wrong += [f"allowance that nothing needs: {one}" for one in allowed if one not in found]
    return wrong + [f"allowance without a reason: {one}" for one, reason in allowed.items() if not reason.strip()]


def prune(root: Path, found: list[str]) -> int:
    """Take the lines of allowances out that nothing needs; how many."""
    path = root / ALLOWANCES
    unneeded = [one for one in allowances(root) if one not in found]
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if unneeded else []
    kept = [line for line in lines if not any(line.startswith(f'"{one}"') for one in unneeded)]
    if unneeded:
        path.write_text("".join(kept), encoding="utf-8")
    return len(lines) - len(kept)


def facts(root: Path, package: str = PACKAGE) -> str:
    """Size of the house in a line."""
    paths = list((root / package).rglob("*.py"))
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
    loose = sum(path.parent == root / package for path in paths)
    return f"{lines} lines in {len(paths)} files, {loose} of them loose at the top"


def main(arguments: list[str] | None = None) -> int:
    """Print what is to be mended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="the project's folder")
    parser.add_argument("--facts", action="store_true", help="also print the size of the house")
    parser.add_argument("--prune", action="store_true", help="take allowances out that nothing needs")
    given = parser.parse_args(arguments)
    found = findings(given.root)
    if given.facts:
        print(facts(given.root))
    if given.prune:
        print(f"{prune(given.root, found)} allowances taken out.")
    wrong = judged(found, allowances(given.root))
    if wrong:
        print(*wrong, sep="\n")
        print(f"{len(wrong)} to mend; what must stay needs a line with its reason in {ALLOWANCES}.", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
