"""The simulated person: which moments look wrong, and what their EEG then says.

Two people can be asked, by name. Both are a function of what has been seen, the same for every
subject and weight.

"path", who answers unless another is asked for: *The robot is expected to get on with it, and to
keep its distance. The more ground a moment gains towards having done the task, beyond the best so
far, the likelier it looks right; at half the robot's full speed it surely does, as far as it goes
with comfort: at 5 cm of clearance or more people are at ease, at 2 cm or less everything looks
wrong.* The ground is measured along the ideal path, in every stage alike: reaching, closing,
lifting, carrying, lowering, opening.

"lay", who knows no ideal path and no remaining length: *The hand, or the can in it, should come
nearer to where it has to go next than it has been; the can should stay upright and not be dropped;
nothing should come too close.*

P(wrong) = 1 - progress x comfort; they differ in what progress is.
"""

import math

import numpy as np
import pandas as pd

from rlihf_lib.task.moment import Moment

SURE_PROGRESS = 0.015  # metres gained in one step of 0.1 s: half the full speed
UNEASY_CLEARANCE = 0.02  # metres between hand or held can and an obstacle: too close
AT_EASE_CLEARANCE = 0.05  # metres from which on nobody minds
ASKEW = math.radians(30)  # tilt of the can that looks wrong to a lay person


def comfort(clearance: float) -> float:
    """How much at ease people are with a clearance, metres: 0 at 2 cm to 1 at 5 cm."""
    share = (clearance - UNEASY_CLEARANCE) / (AT_EASE_CLEARANCE - UNEASY_CLEARANCE)
    return min(max(share, 0.0), 1.0)


def progress(moment: Moment, sure: float = SURE_PROGRESS) -> float:
    """How much a moment gains on the best so far: 0 to 1, which it is from `sure` metres on.

    Nothing where something is hit or the can is lost.
    """
    if moment.lost or moment.collided:
        return 0.0
    return min(max((moment.best - moment.remaining) / sure, 0.0), 1.0)


def path_observer(moment: Moment) -> float:
    """Probability that somebody who knows the ideal path perceives an error in a control step."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment) * comfort(moment.clearance)


def lay_observer(moment: Moment) -> float:
    """Probability that a lay person perceives an error in a control step; see `path_observer`."""
    if moment.success:
        return 0.0
    if moment.lost or moment.collided or moment.dropped or moment.tilt > ASKEW:
        return 1.0
    return 1.0 - min(moment.nearer / SURE_PROGRESS, 1.0) * comfort(moment.clearance)


#: By name, as `RunConfig.observer` names them.
OBSERVERS = {"path": path_observer, "lay": lay_observer}


class Observer:
    """A person whose held-out epochs answer what they see.

    `p_error` are rows of one subject (`rlihf_lib.rl.feedback`), of both classes, else a ValueError.
    `rng` draws what is perceived, by P(wrong) = `looks_wrong(moment)`, and the epochs. p(error) is
    looked up, or decoded anew, as in `rlihf_lib.live`, by `decode`, from the number of an epoch.
    The rows are drawn from at all times alike, or, in as many `parts` of training, from as many
    parts of the rows in their order; again and again, or each `once`.

    Attributes
    ----------
    share : float
        How much of training is over.
    n_fewest, watched, errors_seen : int
        Rows of the class that has fewer; moments seen so far; those that looked wrong.
    """

    def __init__(
        self, p_error: pd.DataFrame, rng, looks_wrong=path_observer, decode=None, parts=1,
        once=False,
    ):  # fmt: skip
        self._p, self._epochs = p_error["p_error"].to_numpy(), p_error["epoch"].to_numpy()
        labels = p_error["label"].to_numpy()
        self.n_fewest = min((labels == label).sum() for label in (0, 1))
        pieces = np.array_split(np.arange(len(labels)), parts)
        self._rows = [[rows[labels[rows] == label] for label in (0, 1)] for rows in pieces]
        for label, name in enumerate(("correct", "error")):
            if not all(len(by_class[label]) for by_class in self._rows):
                raise ValueError(
                    f"the p(error) table has no epoch of class {name!r}; the observer needs both"
                )
        if once:
            self._rows = [[rng.permutation(rows) for rows in by_class] for by_class in self._rows]
        self._rng, self.looks_wrong, self._decode, self._once = rng, looks_wrong, decode, once
        self.share, self.watched, self.errors_seen = 0.0, 0, 0

    def watch(self, moment: Moment, n: int = 1) -> np.ndarray:
        """Answer a moment of `n` control steps by p(error), (n,), of epochs it evokes, Eq. (3)."""
        wrong = int(self._rng.random() < self.looks_wrong(moment))
        self.watched += 1
        self.errors_seen += wrong
        now = self._rows[min(int(self.share * len(self._rows)), len(self._rows) - 1)]
        if self._once:
            rows, now[wrong] = now[wrong][:n], now[wrong][n:]
        else:
            # One at a time: nearly always n is 1, and an array costs thrice as much.
            rows = now[wrong][[self._rng.integers(len(now[wrong])) for _ in range(n)]]
        if self._decode is None:
            return self._p[rows]
        return np.array([self._decode(epoch) for epoch in self._epochs[rows]])
