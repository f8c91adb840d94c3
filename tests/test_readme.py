"""The README names only what exists."""

import re

import pytest

from rlihf_lib.__main__ import parser
from rlihf_lib.study import REPOSITORY

README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_links_and_pictures_exist(target):
    assert target.startswith("http") or (REPOSITORY / target).exists(), target


def test_every_option_is_described_and_every_described_option_exists():
    options = {o for a in parser()._actions for o in a.option_strings if o.startswith("--")}
    described = set(re.findall(r"--[a-z]+", README)) - {"--json"}
    assert options - {"--help"} == described


def test_ci_runs_the_command_of_the_readme():
    command = "pip install -r requirements.txt && python -m pytest"
    assert command in README
    ci = (REPOSITORY / ".ci" / "run").read_text().replace("--quiet ", "")
    assert command in ci
