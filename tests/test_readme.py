"""README and manifests of figures name only what exists."""

import json
import re

import pandas as pd
import pytest

from rlihf_lib.__main__ import parser
from rlihf_lib.files import sha256
from rlihf_lib.rl.incentives import explained_sentence
from rlihf_lib.study import REPOSITORY, Study

README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_links_and_pictures_exist(target):
    assert target.startswith("http") or (REPOSITORY / target).exists(), target


def test_every_option_is_described_and_every_described_option_exists():
    options = {o for a in parser()._actions for o in a.option_strings if o.startswith("--")}
    described = set(re.findall(r"--[a-z][a-z-]+", README)) - {"--json"}
    assert options - {"--help"} == described


def test_ci_runs_the_command_of_the_readme():
    command = "pip install -r requirements.txt && python -m pytest"
    assert command in README
    ci = (REPOSITORY / ".ci" / "run").read_text().replace("--quiet ", "")
    assert command in ci


# Those of `smoke` are not shipped.
@pytest.mark.parametrize("manifest", sorted(REPOSITORY.glob("figures/[!s]*/manifest.json")))
def test_every_shipped_picture_is_in_its_manifest_with_the_data_it_was_drawn_from(manifest):
    entries = json.loads(manifest.read_text(encoding="utf-8"))
    assert {path.stem for path in manifest.parent.glob("*.*[fg]")} == set(entries)
    sources = {
        name: hash_ for entry in entries.values() for name, hash_ in entry["sources"].items()
    }
    stale = [name for name, known in sources.items() if sha256(REPOSITORY / name) != known]
    assert not stale


@pytest.mark.parametrize("observer", ["path", "lay"])
def test_how_much_dense_reward_explains_is_what_notebook_03_computed(observer):
    table = pd.read_csv(Study("quick").tables / "explained_by_dense_rlihf.csv", index_col="robot")
    assert explained_sentence(observer, table[observer]) in " ".join(README.split())
