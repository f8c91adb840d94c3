"""Forms of feedback and observers that the paper does not have; what `beyond` compares."""

import numpy as np
from scipy.special import logit

from rlihf_lib.rl.observer import SURE_PROGRESS, comfort, path_observer, progress
from rlihf_lib.task.moment import Moment


def half(p_error: np.ndarray) -> np.ndarray:
    """Feedback about zero: 0.5 - p."""
    return 0.5 - p_error


def log_odds(p_error: np.ndarray) -> np.ndarray:
    """Feedback by the evidence: log-odds of being right, as if no p were below .001 or above .999.

    So it has hardly a bound: a sure answer counts several times as much as a likely one.
    """
    return -logit(np.clip(p_error, 1e-3, 1 - 1e-3))


def yes_or_no(p_error: np.ndarray) -> np.ndarray:
    """Feedback by the decision alone: 1 if p is below one half, else 0.

    Corrected for known confusions (Wang, Liu & Li 2020, arXiv 1810.01032) it is the same times a
    factor and plus a constant.
    """
    return (p_error < 0.5) * 1.0


def planner(moment: Moment) -> float:
    """P(wrong) of somebody who wants progress and minds no obstacle but a collision."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment)


def wary(moment: Moment) -> float:
    """P(wrong) of somebody at ease only from 6.5 cm on, and not at all up to 3.5."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment) * comfort(moment.clearance - 0.015)


def hates_speed(moment: Moment) -> float:
    """P(wrong) of somebody whom a hand at more than half its full speed frightens.

    Slow steps gain little, so half the progress is enough.
    """
    if moment.success:
        return 0.0
    slow = moment.moved <= SURE_PROGRESS
    return 1.0 - progress(moment, SURE_PROGRESS / 2) * comfort(moment.clearance) * slow


def jumpy(moment: Moment) -> float:
    """P(wrong) by the path, but at least a half where the hand is faster than half its full speed.

    As if muscles and eyes that follow it looked like an error.
    """
    startled = 0.5 if moment.moved > SURE_PROGRESS else 0.0
    return max(path_observer(moment), startled)
