"""The faults of `python -m tests.mutants` are in step with the code that they spoil."""

import pytest

from tests.mutants import REPOSITORY, TESTS, mutants


@pytest.mark.parametrize(("module", "old", "new"), mutants())
def test_each_fault_has_its_place_and_changes_it(module, old, new):
    source = (REPOSITORY / "rlihf_lib" / f"{module}.py").read_text(encoding="utf-8")
    assert source.count(old) == 1 and new not in (old, "")
    compile(source.replace(old, new), module, "exec")


def test_at_least_forty_faults_are_tried_and_their_tests_are_there():
    assert len(mutants()) >= 40
    for module, names in TESTS.items():
        assert any(tried == module for tried, *_ in mutants()), module
        assert all((REPOSITORY / "tests" / f"{name}.py").is_file() for name in names.split())
