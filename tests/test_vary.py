"""What a reader varies gets runs of its own."""

import pytest

from rlihf_lib.study import Study
from rlihf_lib.vary import choose, vary

STUDY = Study()


def hates_speed(moment):
    return float(moment.best - moment.remaining > 0.01)


def test_one_person_is_chosen_by_name_or_is_the_first():
    assert choose(["s02", "s03"]) == "s02" and choose(["s02", "s03"], "s03") == "s03"
    with pytest.raises(ValueError, match="subject is 's99'; choose one of s02, s03"):
        choose(["s02", "s03"], "s99")


def test_any_weights_are_compared_for_one_person_with_any_seeds():
    varied = vary(STUDY, "s04", seeds=[3, 4], weights=[0.2, 1, 3])
    configs = varied.run_configs("ablation")
    assert [c.w_hf for c in configs] == [0.2, 0.2, 1, 1, 3, 3]
    assert {(c.subject, c.seed) for c in configs} == {("s04", 3), ("s04", 4)}


def test_nothing_varied_is_the_study_itself():
    assert vary(STUDY) is STUDY
    assert vary(STUDY, "", None, [], 0, "", "", {}) is STUDY


def test_varied_runs_have_what_was_asked_for_and_folders_of_their_own():
    varied = vary(STUDY, "s04", 0.3, [5], 20_000, hates_speed, sac={"n_steps": 1})
    (config,) = varied.run_configs("rlihf")
    assert (config.subject, config.w_hf, config.seed) == ("s04", 0.3, 5)
    assert (config.total_steps, config.sac.n_steps) == (20_000, 1)
    assert config.observer.name == "hates_speed"
    assert varied.runs.is_relative_to(STUDY.results / "varied") and varied.runs != STUDY.runs
    assert varied.figures.parent == varied.runs.parent
    assert varied.decoder == STUDY.decoder
    assert "hates_speed" in varied.profile.name and "20000" in varied.profile.name
    assert STUDY.run_configs("rlihf")[0].total_steps == 150_000, "the study stays as it was"


def test_other_values_have_other_folders_and_equal_ones_the_same():
    folders = [
        vary(STUDY, **told).runs
        for told in ({"w_hf": 0.3}, {"w_hf": 0.4}, {"observer": "lay"}, {"seeds": [7]},
                     {"subject": "s04"}, {"total_steps": 10_000}, {"sac": {"tau": 0.02}})
    ]  # fmt: skip
    assert len(set(folders)) == len(folders)
    assert vary(STUDY, w_hf=0.3).runs == folders[0]
    assert vary(STUDY, w_hf=0).run_configs("rlihf")[0].w_hf == 0


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"subject": "s99"}, "subject is 's99'; choose one of s02"),
        ({"w_hf": "much"}, "w_hf: 'much' is no weight; give a number from 0 to 10"),
        ({"w_hf": -1}, "w_hf: -1 is no weight"),
        ({"weights": [0.1, 11]}, "weights: 11 is no weight"),
        ({"weights": [0.3]}, "is one; notebook 05 compares two or more"),
        ({"seeds": [0.5]}, "give whole numbers"),
        ({"total_steps": 1234}, "total_steps is 1234; give a multiple of 10000"),
        ({"observer": "boss"}, "observer is 'boss'; choose one of path, lay"),
        ({"reward": "money"}, "reward is 'money'; choose one of path"),
        ({"sac": {"tua": 0.1}}, "sac has no tua; it has hidden"),
    ],
)
def test_what_is_impossible_is_refused_in_a_sentence(told, message):
    with pytest.raises(ValueError, match=message):
        vary(STUDY, **told)
