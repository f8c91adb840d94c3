"""The simulated person: which moments look wrong, and what their EEG then says.

The rule, in words: *The observer expects the robot to get on with it. The more ground a moment
gains towards having done the task, beyond the best so far, the likelier it looks right; at half the
robot's full speed it surely does. It looks wrong when the robot stands still, drifts, goes back or
makes up for ground it has lost, and always when hand or can come uncomfortably close to something
that is not to be touched.* The rule is the same for every subject and weight, depends only on what
has been seen, and uses the same length of remaining path in every stage: reaching, closing,
lifting, carrying, lowering, opening.
"""

import numpy as np
import pandas as pd

SURE_PROGRESS = 0.015  # metres of remaining path in one step of 0.1 s: half the full speed
PREFERRED_CLEARANCE = 0.02  # metres between hand or can and an obstacle below which people worry


def looks_wrong(moment):
    """Probability that the observer perceives an error in one control step.

    Parameters
    ----------
    moment : rlihf_lib.task.gym_env.Moment
        What can be seen of the step.

    Returns
    -------
    float
        In [0, 1]; falls linearly with the ground gained.
    """
    if moment.success:
        return 0.0
    if moment.lost or moment.collided or moment.clearance < PREFERRED_CLEARANCE:
        return 1.0
    return 1.0 - min(max((moment.best - moment.remaining) / SURE_PROGRESS, 0.0), 1.0)


class Observer:
    """A person whose held-out epochs answer what they see.

    Parameters
    ----------
    p_error : DataFrame
        Decoded held-out epochs of one subject, columns `epoch`, `label` (1 = error) and `p_error`
        in [0, 1].
    rng : numpy.random.Generator
        Draws what is perceived, and the epochs.
    decode : callable, optional
        `decode(epoch)` decodes the epoch of that number anew, as `rlihf_lib.live` does; by default
        p(error) is looked up in the table.

    Raises
    ------
    ValueError
        If one of the two classes has no epoch.
    """

    def __init__(self, p_error, rng, decode=None):
        self._p, self._epochs = p_error["p_error"].to_numpy(), p_error["epoch"].to_numpy()
        self._rows = [np.flatnonzero(p_error["label"] == label) for label in (0, 1)]
        for label, name in enumerate(("correct", "error")):
            if len(self._rows[label]) == 0:
                raise ValueError(
                    f"the p(error) table has no epoch of class {name!r}; the observer needs both"
                )
        self._rng, self._decode = rng, decode
        self.errors_seen = 0

    def watch(self, moment, n=1):
        """Answer a moment that lasts for `n` control steps, Eq. (3).

        Returns
        -------
        p_error : ndarray, shape (n,)
            Of epochs of the class that the moment evokes.
        """
        wrong = int(self._rng.random() < looks_wrong(moment))
        self.errors_seen += wrong
        rows = self._rows[wrong]
        # One at a time: nearly always n is 1, and an array costs thrice as much.
        rows = rows[[self._rng.integers(len(rows)) for _ in range(n)]]
        if self._decode is None:
            return self._p[rows]
        return np.array([self._decode(epoch) for epoch in self._epochs[rows]])


def perfect_table():
    """Return the p(error) table of an ideal decoder, p = label."""
    return pd.DataFrame({"epoch": [0, 1], "label": [0, 1], "p_error": [0.0, 1.0]})
