"""Exercises of the notebooks: what a reader's answer is worth."""

from collections.abc import Callable
from typing import Any

import numpy as np

TOLERANCE = 1e-3  # relative; of an answer that counts as right, or as a known wrong one


def judge(number: int, yours: Any, right: Any, hints: dict[str, Any], praise: str) -> None:
    """Print whether the answer to an exercise is right and, if it isn't, the hint that fits.

    Parameters
    ----------
    number : int
        Of the exercise.
    yours : float or array-like or None
        The answer; None, or nothing but None, where nobody has worked yet.
    right : float or array-like
        The answer as it is found in another way.
    hints : dict
        A sentence -> the wrong answer that calls for it, or None for any other wrong answer.
    praise : str
        What a right answer gets to read.
    """

    def verdict():
        answer = np.asarray(right, float)
        if all(value is None for value in np.ravel(np.array(yours, object))):
            return None
        if not _is_like(answer, yours):
            return False, "The function does not return what it is asked for."
        if _is(answer, yours):
            return True, praise
        fitting = (hint for hint, wrong in hints.items() if wrong is None or _is(wrong, yours))
        return False, next(fitting, "")

    check(number, verdict)


def check(number: int, verdict: Callable[[], tuple[bool, str] | None]) -> None:
    """Print whether an answer that has to be tried out is right.

    `verdict` tries it and returns whether it is right and what was seen, in a sentence or two; None
    where nobody has worked yet. What raises is told, so that the notebook goes on.
    """
    try:
        found = verdict()
    except Exception as error:
        found = False, f"It stops with {type(error).__name__}: {error}"
    if found is None:
        said = "nothing to check yet"
    else:
        right, words = found
        said = f"{'right' if right else 'not yet'}. {words}".rstrip()
    print(f"Exercise {number}: {said}")


def _is_like(right, yours):
    try:
        yours = np.asarray(yours, float)
    except (TypeError, ValueError):
        return False
    return yours.shape == right.shape and bool(np.isfinite(yours).all())


def _is(answer, yours):
    return np.allclose(yours, answer, rtol=TOLERANCE, atol=0)
