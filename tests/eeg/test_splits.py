import pytest

from rlihf_lib.eeg.splits import Fold, LeakageError, leave_one_subject_out

SUBJECTS = ["s02", "s03", "s04", "s05"]


def test_every_subject_is_held_out_once_and_roles_never_overlap():
    folds = leave_one_subject_out(SUBJECTS, n_networks=3, n_validation=2)
    assert [fold.test for fold in folds] == SUBJECTS
    for fold in folds:
        assert sorted((fold.test, *fold.pool)) == SUBJECTS
        for network, validation in enumerate(fold.validation):
            roles = [fold.test, *validation, *fold.training(network)]
            assert sorted(roles) == SUBJECTS


def test_networks_of_a_fold_together_train_on_the_whole_pool():
    for fold in leave_one_subject_out(SUBJECTS, n_networks=2, n_validation=1):
        assert set(fold.training(0)) | set(fold.training(1)) == set(fold.pool)


def test_three_subjects_are_one_of_each_role():
    fold = leave_one_subject_out(SUBJECTS[:3])[0]
    assert len(fold.validation[0]) == len(fold.training(0)) == 1


def test_fewer_than_three_subjects_are_refused():
    with pytest.raises(ValueError, match="at least three"):
        leave_one_subject_out(SUBJECTS[:2])


@pytest.mark.parametrize(
    ("test", "pool", "validation", "message"),
    [
        ("s02", ("s02", "s03", "s04"), (("s03",),), "own training pool"),
        ("s02", ("s03", "s04"), (("s02",),), "not in the pool"),
        ("s02", ("s03", "s03", "s04"), (("s03",),), "twice"),
        ("s02", ("s03", "s04"), (("s03", "s04"),), "validation and a training subject"),
        ("s02", ("s03", "s04"), ((),), "validation and a training subject"),
        ("s02", ("s03", "s04"), (), "at least one network"),
    ],
)
def test_a_leaking_fold_cannot_be_made(test, pool, validation, message):
    with pytest.raises(ValueError, match=message):
        Fold(test, pool, validation)


def test_the_held_out_subject_cannot_be_reached_from_the_training_pool():
    secret = object()
    data = {subject: subject.upper() for subject in SUBJECTS} | {"s03": secret}
    fold = leave_one_subject_out(SUBJECTS)[1]
    pool = fold.training_pool(data)
    assert dict(pool) == {"s04": "S04", "s05": "S05", "s02": "S02"}
    for cheat in (lambda: pool["s03"], lambda: pool.get("s99") or pool["s99"]):
        with pytest.raises(LeakageError, match="not in the training pool"):
            cheat()
    assert "s03" not in pool and secret not in vars(pool)["_data"].values()


def test_adding_the_held_out_subject_to_the_data_afterwards_does_not_help():
    data = {subject: subject for subject in SUBJECTS}
    fold = leave_one_subject_out(SUBJECTS)[1]
    pool = fold.training_pool(data)
    data["s04"] = data["s03"]
    assert pool["s04"] == "s04" and len(pool) == 3
    with pytest.raises(TypeError):
        pool["s03"] = data["s03"]
    with pytest.raises(AttributeError):
        fold.pool = SUBJECTS
