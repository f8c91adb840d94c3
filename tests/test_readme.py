"""Pages name only what exists, and say only what was computed."""

import json
import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from rlihf_lib.__main__ import parser
from rlihf_lib.report.saving import stale
from rlihf_lib.study import REPOSITORY, Study
from tests.pages import CAPTIONS, PAGES, filled

README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
DOCUMENTS = (
    *PAGES,
    ".github/CONTRIBUTING.md",
    "notebooks/README.md",
    "notebooks/choices.md",
    "tests/README.md",
    "tests/benchmarks/README.md",
)
LINKS = [
    (page, target)
    for page in DOCUMENTS
    for target in re.findall(r"\]\(([^)]+)\)", (REPOSITORY / page).read_text(encoding="utf-8"))
]


def test_every_dependency_is_locked_with_its_hash_at_a_version_that_is_allowed():
    with (REPOSITORY / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    lines = (REPOSITORY / ".ci/lock-linux-x86_64-py311.txt").read_text().splitlines()
    locked = {}
    for line in lines[3:]:
        requirement, digest = line.split(" --hash=sha256:")
        name, version = requirement.split("==")
        assert len(digest) == 64
        locked[canonicalize_name(name)] = version
    for text in (*project["dependencies"], *project["optional-dependencies"]["dev"]):
        wanted = Requirement(text)
        version = locked[canonicalize_name(wanted.name)]
        assert wanted.specifier.contains(version), f"{text}, but {version} is locked"


@pytest.mark.parametrize(("page", "target"), sorted(set(LINKS)))
def test_links_and_pictures_exist(page, target):
    if target.startswith("http"):
        return
    path, _, section = target.partition("#")
    path = (REPOSITORY / page).parent / path if path else REPOSITORY / page
    assert path.exists(), target
    titles = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M) if section else []
    assert not section or section in [title.lower().replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES)
def test_what_pages_compute_is_what_the_tables_say(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    assert filled(text, Study()) == text, "python -m tests.pages"


def test_readme_is_read_in_a_minute_and_its_pictures_say_what_they_show():
    assert len(README.split()) <= 800
    pictures = re.findall(r"!\[([^]]*)\]", README)
    assert pictures and all(len(words) > 20 for words in pictures)


def test_options_in_the_readme_exist():
    options = {o for a in parser()._actions for o in a.option_strings}
    lines = [line for line in README.splitlines() if "pip install" not in line]
    assert set(re.findall(r"--[a-z][a-z-]+", "\n".join(lines))) <= options


def test_ci_runs_the_command_of_the_readme():
    command = "pip install -r requirements.txt && python -m pytest"
    assert command in README
    ci = (REPOSITORY / ".ci" / "run").read_text().replace("--quiet ", "")
    assert command in ci


# Those of `smoke` are not shipped.
@pytest.mark.parametrize("manifest", sorted(REPOSITORY.glob("figures/[!s]*/manifest.json")))
def test_every_shipped_picture_is_in_its_manifest_with_the_data_it_was_drawn_from(manifest):
    entries = json.loads(manifest.read_text(encoding="utf-8"))
    assert {path.stem for path in manifest.parent.glob("*.*[fg]")} == set(entries) <= set(CAPTIONS)
    profile, _, eeg = manifest.parent.name.partition("-")
    assert not stale(Study(profile, eeg))
