"""What a reward makes worthwhile: scripted robots judged by it, in expectation.

Feedback is random twice over, in what the observer perceives and in the epoch that answers. Its
expectation is not: with P the observer's P(wrong) and m0, m1 the mean p(error) of the subject's
correct and error epochs, E[1 - p] = 1 - (1 - P) m0 - P m1. So returns are computed without drawing
a single epoch, and what varies is the placement.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import accumulate, product

import numpy as np
import pandas as pd
from scipy import stats

from rlihf_lib.rl.evaluation import watch
from rlihf_lib.rl.feedback import rows_of
from rlihf_lib.rl.observer import OBSERVERS, SURE_PROGRESS
from rlihf_lib.rl.rewards import PROGRESS, alignment_reward, task_reward
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.moment import Moment
from rlihf_lib.task.scripted import EXPLOITERS, expert_action

HORIZON = 200  # steps that robots are watched
STEADY = 50  # last steps of an unfinished episode, which are taken to go on for ever
FULL_SPEED = PROGRESS * SURE_PROGRESS  # dense reward of the progress that surely looks right


def play(env: PickPlaceEnv, seeds: Iterable[int]) -> dict[tuple[str, int], tuple]:
    """Watch the expert and every exploiter: what `watch` returns, by robot and seed."""
    return {
        (act.__name__.removesuffix("_action"), seed): watch(env, act, seed, HORIZON)
        for act in (expert_action, *EXPLOITERS)
        for seed in seeds
    }


def expected_feedback(
    moments: Sequence[Moment], observer: Callable, p_error: pd.DataFrame
) -> tuple[np.ndarray, np.ndarray]:
    """Expected reward 1 - p(error) of each moment, and its SD, (n,) each, by a subject's rows."""
    wrong = np.array([observer(moment) for moment in moments])
    by_class = p_error.groupby("label")["p_error"]
    means, squares = by_class.mean(), by_class.agg(lambda p: (p**2).mean())
    mean = (1 - wrong) * means[0] + wrong * means[1]
    square = (1 - wrong) * squares[0] + wrong * squares[1]
    return 1 - mean, np.sqrt(np.maximum(square - mean**2, 0))


def discounted_returns(
    rewards: Iterable[float], terminated: bool, discount: float, horizon: int = HORIZON
) -> np.ndarray:
    """Discounted return from every step on, (horizon,); steps after the end have that of the end.

    The last reward of a terminated episode is paid for all that follows.
    """
    rewards = list(rewards)
    later = rewards.pop() if terminated else np.mean(rewards[-STEADY:]) / (1 - discount)
    steps = accumulate(reversed(rewards), lambda g, r: r + discount * g, initial=later)
    return np.array([*list(steps)[::-1], *horizon * [later]][:horizon])


def expected_returns(
    played: dict, observer: Callable, p_error: pd.DataFrame, w_hf: float, discount: float
) -> pd.DataFrame:
    """Judge the robots of `play` by the feedback that one subject's rows give.

    Returns
    -------
    DataFrame
        A row per robot and placement: robot, seed, from_start (expected discounted return from the
        first step), average (from every step, averaged), noise (SD of a single step's reward).
    """
    rows = []
    for (robot, seed), (moments, terminated) in played.items():
        feedback, sd = expected_feedback(moments, observer, p_error)
        task = np.array([task_reward(moment, discount) for moment in moments])
        rewards = task + w_hf * feedback
        if terminated:  # the observer goes on watching
            rewards[-1] += w_hf * feedback[-1] * discount / (1 - discount)
        returns = discounted_returns(rewards, terminated, discount)
        rows.append((robot, seed, returns[0], returns.mean(), w_hf * sd.mean()))
    return pd.DataFrame(rows, columns=["robot", "seed", "from_start", "average", "noise"])


def margin(returns: pd.DataFrame, discount: float) -> dict:
    """How far the expert is ahead of the best exploiter, in units of the feedback's noise.

    Returns
    -------
    dict
        best exploiter (from the start); ratio from start, ratio on average: of the expert's return
        to the best exploiter's; margin, low, high: difference of the returns from the start over
        the standard deviation that the noise of single steps gives a return,
        sd / sqrt(1 - discount^2), and its 95 % t interval over placements.
    """
    table = returns.pivot(index="seed", columns="robot")
    start, average = table["from_start"], table["average"]
    others = start.columns.drop("expert")
    best = start[others].mean().idxmax()
    noise = returns.loc[returns["robot"] == "expert", "noise"].mean() / np.sqrt(1 - discount**2)
    ahead = (start["expert"] - start[best]) / noise
    low, high = stats.t.interval(0.95, len(ahead) - 1, ahead.mean(), stats.sem(ahead))
    return {
        "best exploiter": best,
        "ratio from start": start["expert"].mean() / start[best].mean(),
        "ratio on average": average["expert"].mean() / average[others].mean().max(),
        "margin": ahead.mean(), "low": low, "high": high,
    }  # fmt: skip


def margins(
    played: dict, p_error: pd.DataFrame, people: Sequence[str], w_hf: float, discount: float
) -> pd.DataFrame:
    """Return a row per person and observer: subject, observer, and what `margin` returns."""
    rows = []
    for subject, (name, observer) in product(people, OBSERVERS.items()):
        own = rows_of(p_error, subject)
        returns = expected_returns(played, observer, own, w_hf, discount)
        rows.append({"subject": subject, "observer": name, **margin(returns, discount)})
    return pd.DataFrame(rows)


def explained_by_dense(moments: Sequence[Moment], observer: Callable) -> float:
    """Share of the variance of P(right) that the engineer's reward explains (R squared).

    Squared correlation with the dense reward, cut off where progress surely looks right, and 0 for
    collisions. NaN where one of the two never varies.
    """
    dense = [(not m.collided) * min(alignment_reward(m), FULL_SPEED) for m in moments]
    right = [1 - observer(moment) for moment in moments]
    if np.ptp(dense) == 0 or np.ptp(right) == 0:
        return np.nan
    return float(np.corrcoef(dense, right)[0, 1] ** 2)


def explained_sentence(observer: str, values: pd.Series) -> str:
    """Say in a sentence what `explained_by_dense` found, by robot, of the observer of a name."""
    each = ", ".join(f"{value:.0%} ({robot})" for robot, value in values.dropna().items())
    return f"The dense reward explains {each} of what the {observer} observer takes for right."
