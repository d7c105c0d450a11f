"""What a release ships beside the wheel agrees with the package: image, conda recipe, citation,
system libraries."""

import os
import re
import tomllib

import yaml
from commands import in_a_process
from loaded import ROOT

from sumo_eval.cosim.sumo.insides import SYSTEM_LIBRARIES

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def text(name):
    return (ROOT / name).read_text()


def requirement(line):
    """Name and versions of a requirement, without spaces."""
    name, versions = re.fullmatch(
        r"([A-Za-z0-9_.-]+) "
        r"*(.*)",
        line.strip(),
    ).groups()
    return name, versions.replace(" ", "")


def test_the_conda_recipe_requires_what_the_package_requires():
    source = text("packaging/conda/meta.yaml")
    recipe = yaml.safe_load(
        re.sub(r"\{% .*? %\}", "", source).replace("{{ ", "").replace(" }}", "")
    )
    run = dict(requirement(line) for line in recipe["requirements"]["run"])
    assert run.pop("python") == PROJECT["requires-python"]
    wheels = dict(requirement(line) for line in re.findall(r'"([^"]+)"', source.split("{%")[0]))
    assert {**run, **wheels} == dict(requirement(line) for line in PROJECT["dependencies"])
    assert set(wheels) == {"libsumo", "covertable"}
    assert f'version = "{PROJECT["version"]}"' in source
    assert recipe["build"]["entry_points"] == [f"sumo-eval = {PROJECT['scripts']['sumo-eval']}"]
    (builder,) = tomllib.loads(text("pyproject.toml"))["build-system"]["requires"]
    assert requirement(builder) in [requirement(line) for line in recipe["requirements"]["host"]]


def test_the_citation_names_the_version_the_licence_and_the_paper():
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    (paper,) = citation["references"]
    assert PROJECT["urls"]["Paper"] == f"https://doi.org/{paper['doi']}"


def test_the_image_and_the_pages_name_the_system_libraries_that_sumo_links():
    packages = " ".join(SYSTEM_LIBRARIES)
    assert f"install --yes --no-install-recommends {packages}" in text("Dockerfile")
    for page in ("README.md", "docs/index.md", "docs/ci.md"):
        assert packages in text(page), page


def test_a_missing_system_library_names_its_install_command(tmp_path):
    """A libsumo that cannot be loaded, as in a container without a desktop's libraries."""
    words = "libGL.so.1: cannot open shared object file: No such file or directory"
    (tmp_path / "libsumo.py").write_text(f"raise ImportError({words!r})\n")
    (tmp_path / "evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "cut_in"\n[[ads]]\nname = "idm"\ncontroller = "idm"\n'
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = in_a_process("run", "evaluation.toml", "--out", "run", cwd=tmp_path, env=environment)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        f"sumo-eval: SUMO's library cannot be loaded: {words}. It needs system libraries that a "
        "machine without a "
        "desktop may lack; on Debian and Ubuntu: apt-get install --no-install-recommends "
        f"{' '.join(SYSTEM_LIBRARIES)}"
    ]
