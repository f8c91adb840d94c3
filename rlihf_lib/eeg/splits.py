"""Leave one subject out: who trains, who validates, who is held out, and nothing in between."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass


class LeakageError(KeyError):
    """Something asked for the data of a subject it must not see."""

    def __str__(self):
        return self.args[0]


@dataclass(frozen=True)
class Fold:
    """One held-out subject, and for every network the subjects that train and validate it.

    A ValueError refuses a fold in which a subject has two roles, or a network lacks one.
    """

    test: str  # held-out subject
    pool: tuple  # everybody else
    #: For every network the subjects of the pool, a tuple of str, that decide when its training
    #: stops. The rest of the pool trains it.
    validation: tuple

    def __post_init__(self):
        if self.test in self.pool:
            raise ValueError(f"the held-out subject {self.test} is in its own training pool")
        if len(set(self.pool)) < len(self.pool):
            raise ValueError(f"a subject is twice in the training pool {', '.join(self.pool)}")
        if not self.validation:
            raise ValueError("a fold needs at least one network")
        for subjects in self.validation:
            if strangers := set(subjects) - set(self.pool):
                raise ValueError(
                    f"validation subject(s) {', '.join(sorted(strangers))} are not in the pool"
                )
            if not subjects or set(subjects) == set(self.pool):
                raise ValueError("every network needs a validation and a training subject")

    def training(self, network) -> tuple:
        """Subjects that train network number `network`."""
        return tuple(s for s in self.pool if s not in self.validation[network])

    def training_pool(self, data) -> "TrainingPool":
        """The pool's part of `data`, a mapping from all subjects."""
        return TrainingPool(self, data)


class TrainingPool(Mapping):
    """The data of a fold's pool, the only thing that whatever is fitted gets to see.

    Asking for the held-out subject, or anyone else outside the pool, raises a `LeakageError`.
    """

    def __init__(self, fold: Fold, data):
        self.fold = fold
        # A copy of the references: the data of the held-out subject are not even reachable.
        self._data = {subject: data[subject] for subject in fold.pool}

    def __getitem__(self, subject):
        if subject not in self._data:
            raise LeakageError(
                f"subject {subject!r} is not in the training pool of the fold that holds out "
                f"{self.fold.test!r}; fit on {', '.join(self.fold.pool)} only"
            )
        return self._data[subject]

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)


def leave_one_subject_out(subjects, n_networks=1, n_validation=2) -> list[Fold]:
    """Make one fold per subject, of which there must be three: to train, validate and test.

    Their order decides who validates: of a fold's networks, each has `n_validation` subjects to
    validate it, fewer where the pool is small. They go round the pool, so that the networks
    together learn from all of it.
    """
    subjects = tuple(subjects)
    if len(subjects) < 3:
        raise ValueError(
            f"{len(subjects)} subject(s) ({', '.join(subjects)}): leave-one-subject-out needs at "
            "least three, one each to train, validate and test"
        )
    folds = []
    for position, test in enumerate(subjects):
        pool = subjects[position + 1 :] + subjects[:position]
        size = min(n_validation, len(pool) - 1)
        validation = tuple(
            tuple(pool[(network * size + i) % len(pool)] for i in range(size))
            for network in range(n_networks)
        )
        folds.append(Fold(test, pool, validation))
    return folds
