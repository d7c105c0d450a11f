"""The certificates and settings of docs/clusters.md, word for word: a cluster on loopback that
talks to nobody else."""

import os
import re
import shutil
import sys

import pytest
from commands import in_a_process, program
from loaded import ROOT
from record.runs import digest, write_evaluation
from record.test_cluster import started

pytest.importorskip("distributed")
PAGE = ROOT / "docs" / "clusters.md"

pytestmark = [
    pytest.mark.skipif(
        not (shutil.which("openssl") and shutil.which("bash")), reason="needs openssl and bash"
    ),
    pytest.mark.skipif(sys.platform != "linux", reason="child processes need Linux"),
]


def block(begins):
    """The shell block of the page that begins with a word."""
    (found,) = [
        text
        for text in re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
        if text.startswith(begins)
    ]
    return str(found)


def with_certificates(folder):
    """Certificates made as the page says, and the environment that it asks for."""
    program("bash", "-ec", block("openssl"), cwd=folder)
    shown = program("bash", "-ec", block("export") + "\nenv -0", cwd=folder)
    return dict(pair.split("=", 1) for pair in shown.stdout.split("\0") if "=" in pair)


@pytest.mark.campaign
def test_a_cluster_with_the_certificates_of_the_page_runs_cases_and_refuses_who_has_none(tmp_path):
    environment = with_certificates(tmp_path)
    path = write_evaluation(tmp_path, levels=2)

    def run(out, env, *options):
        return in_a_process("run", path, "--out", tmp_path / out, *options, env=env)

    with started(tmp_path, "--protocol", "tls", env=environment) as cluster:
        scheduler = cluster.listen()
        assert scheduler.startswith("tls://127.0.0.1:")
        cluster.worker("--host", "127.0.0.1", "--no-nanny")
        done = run("far", environment, "--engine", "dask", "--scheduler", scheduler)
        assert done.returncode == 0, done.stderr
        without, open_one = dict(os.environ), scheduler.replace("tls", "tcp")
        for out, env, named in (
            ("a", without, scheduler),
            ("b", without, open_one),
            ("c", environment, open_one),
        ):
            refused = run(out, env, "--engine", "dask", "--scheduler", named)
            assert (refused.returncode, "Traceback" in refused.stderr) == (2, False), refused.stderr
            assert "There is no Dask scheduler at" in refused.stderr
    assert run("near", dict(os.environ)).returncode == 0
    assert digest(tmp_path / "far") == digest(tmp_path / "near")
