"""Forms of feedback and observers that the paper does not have; what `beyond` compares."""

from collections.abc import Callable

import numpy as np
from scipy.special import logit

from rlihf_lib.rl.observer import SURE_PROGRESS, comfort, progress
from rlihf_lib.task.moment import Moment


def half(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback about zero: 0.5 - p."""
    return 0.5 - p_error


def log_odds(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback by the evidence: log-odds of being right, at most 3 either way."""
    return np.clip(-logit(np.clip(p_error, 1e-3, 1 - 1e-3)), -3, 3)


def yes_or_no(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback by the decision alone: 1 if p is below one half, else 0."""
    return (p_error < 0.5) * 1.0


def corrected(hit_rate: float, false_alarm_rate: float) -> Callable:
    """Feedback that is 1 for right and 0 for wrong steps on average, however the decoder errs.

    Of the decision alone, by the confusions that are known of it: the unbiased reward of Wang, Liu
    & Li 2020 (arXiv 1810.01032).
    """

    def unbiased(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
        said = (p_error >= 0.5) * 1.0
        return 1 - (said - false_alarm_rate) / (hit_rate - false_alarm_rate)

    return unbiased


def fading(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that falls to nothing in the course of training."""
    return (1 - share) * (1 - p_error)


def growing(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that counts ever more."""
    return share * (1 - p_error)


def doubting(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that counts as far as the critics disagree, fully from a tenth of the values on."""
    return min(10 * doubt, 1.0) * (1 - p_error)


def planner(moment: Moment) -> float:
    """P(wrong) of somebody who wants progress and minds no obstacle but a collision."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment)


def wary(moment: Moment) -> float:
    """P(wrong) of somebody at ease only from 8 cm on, who is content with half the progress."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment, SURE_PROGRESS / 2) * comfort(moment.clearance - 0.03)


def hates_speed(moment: Moment) -> float:
    """P(wrong) of somebody whom more than 1 cm a step frightens."""
    if moment.success:
        return 0.0
    slow = moment.best - moment.remaining < 0.01
    return 1.0 - progress(moment, SURE_PROGRESS / 2) * comfort(moment.clearance) * slow
