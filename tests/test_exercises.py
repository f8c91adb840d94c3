"""Exercises of the notebooks: solutions are right, and wrong answers are told so."""

import re
import shutil
from copy import deepcopy

import numpy as np
import pytest
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell
from papermill.iorw import load_notebook_node
from papermill.parameterize import parameterize_notebook

from rlihf_lib.exercises import check, judge
from rlihf_lib.regenerate import NOTEBOOKS
from rlihf_lib.study import REPOSITORY, Study
from tests.eeg.conftest import planted_epochs

TAG = re.compile(r"exercise-(\d+)$")
FENCED = re.compile(r"<details>.*?```python\n(.*?)\n```.*?</details>", re.S)
SHIPPED = f"results/{Study().name}"
#: What is small enough to be computed here. Exercises of the other notebooks need nothing but the
#: cell of imports and what follows "Your turn", as the teacher's page says, and what is shipped.
SMALL = {"01_dataset_preprocessing": "simulated", "02_loso_decoder": "a folder of epochs"}
#: Wrong answers to the exercises of a notebook, and a word of the hint.
WRONG = {
    "01_dataset_preprocessing": {
        1: {
            "def your_peak(t, *_): return -value * t[0, 0] / trials[0, 0], latency": "turned",
            "def your_peak(t, *_): return value * t[0, 0] / trials[0, 0], 1e3 * latency": "in ms",
            "def your_peak(*_): return 300": "not return what it is asked for",
        },
        2: {
            "def your_count(peak, sd): return np.ceil((sd / peak) ** 2)": "two are asked",
            "def your_count(peak, sd): return (2 * sd / peak) ** 2": "round up",
        },
    },
    "02_loso_decoder": {
        1: {
            "def your_threshold(miss, false_alarm): return miss / (miss + false_alarm)": "swapped",
            "def your_threshold(miss, false_alarm): return false_alarm / miss": "odds",
        },
        2: {
            "def your_aurocs(*_): return compared.loc[person, ['auroc_lda'] * 2]": "leaks",
            "def your_aurocs(*_): return 0.5, 0.5": "owner != held_out",
        },
    },
    "03_policy_training": {
        1: {
            "def your_observer(m): return float(m.best - m.remaining < 0.02)": "P(right)?",
            "def your_observer(m): return float(m.best - m.remaining > 0.01)": "shouldn't please",
            "def your_observer(m): return 100 * m.gained": "a probability",
            "def your_observer(m): return m.speed": "no attribute 'speed'",
        },
        2: {
            "def your_reward(m): return max(0, m.best - m.remaining)": "No cheat pays",
            "def your_reward(m): return float(m.success)": "No cheat pays",
            "def your_reward(m): return 1.0 - m.success": "can not placed, is paid better",
            "def your_reward(m): return 1.0": "nothing is asked for",
            "def your_reward(m): return -1.0 * m.grasped": "expert should collect something",
        },
    },
    "04_metrics_tables": {
        1: {
            "def your_seeds(m): return 2 + (m > 1) + (m > 6)": "In how many ways",
            "def your_seeds(m): return 4": "number of tests",
            "def your_seeds(m): return 4 if m < 6 else 5": "two-sided",
            "def your_seeds(m): return 6 + (m > 1) + (m > 3) + (m > 6)": "Signs of pairs",
        },
        2: {
            "from rlihf_lib.task.scripted import expert_action as your_robot": "places the can",
            "from rlihf_lib.task.scripted import sit_still as your_robot": "Go straight on",
            "from rlihf_lib.task.scripted import knock_things_off as your_robot": "obstacle",
            "def your_robot(env): return np.array([0, 0, 1, -1])": "Stay on the path",
        },
    },
    "05_whf_ablation": {
        1: {
            "def your_ratio(w, *_): return ratio * w, steps[w]": "noise has the weight",
            "def your_ratio(w, *_): return ratio / 2**0.5, steps[w]": "not of their sum",
            "def your_ratio(w, *_): return -ratio, -steps[w]": "signs are turned",
            "def your_ratio(w, *_): return ratio, steps[w] / 2": "costs 2",
            "def your_ratio(w, *_): return ratio": "not return what it is asked for",
        },
        2: {
            "def your_share(r, w, k): return (w[:, None] > r).mean()": "how often the step",
            "def your_share(r, w, k): return (w[:, None] < r).mean()": "means of nine",
            "def your_share(r, w, k): return 0.5": "by SciPy",
        },
    },
    "06_beyond_the_paper": {
        1: {
            "def your_auroc(h, m, c, f): return (h + c) / (h + m + c + f)": "That is accuracy",
            "def your_auroc(h, m, c, f): return h / (h + m)": "hit rate",
            "def your_auroc(h, m, c, f): return h / (h + m) * c / (c + f)": "Ties count one half",
            "def your_auroc(h, m, c, f): return 0.5": "Over all pairs",
        },
        2: {
            "def your_equal(h, *_): return dict(zip(counts[:, 0], d))[h]": "That is d'",
            "def your_equal(h, *_): return norm.cdf(dict(zip(counts[:, 0], d))[h])": "root of 2",
            "def your_equal(h, m, c, f): return (h / (h + m) + c / (c + f)) / 2": "of ranks",
            "def your_equal(*_): return 0.5": "root of the mean of both variances",
        },
    },
}


def tagged(nb, name):
    """Position of the one cell with this tag."""
    (place,) = (i for i, cell in enumerate(nb.cells) if name in cell.metadata.get("tags", []))
    return place


def exercises(nb):
    """Numbers of the exercises, from the tags of their places to work."""
    tags = [tag for cell in nb.cells for tag in cell.metadata.get("tags", [])]
    return [int(found[1]) for found in map(TAG.match, tags) if found]


SOURCES = {path.stem: load_notebook_node(str(path)) for path in NOTEBOOKS.glob("*.ipynb")}
WITH_EXERCISES = sorted(name for name, nb in SOURCES.items() if exercises(nb))


class Reader:
    """Runs a notebook to its last check, works on exercises, and reads what their checks say."""

    def __init__(self, name, out):
        self.name = name
        parameters = {"out": str(out), "workers": 1}
        if name in SMALL:
            parameters["profile"] = "smoke"
        else:
            shutil.copytree(REPOSITORY / SHIPPED, out / SHIPPED)
        if SMALL.get(name) == "a folder of epochs":
            parameters["eeg"] = str(out)
            for number in (1, 2, 3):
                planted_epochs(number, amplitude=3e-6).save(out / f"sub-{number}_epo.fif")
        self.nb = parameterize_notebook(deepcopy(SOURCES[name]), parameters)
        last = tagged(self.nb, f"check-{max(exercises(self.nb))}")
        self.nb.cells = self.nb.cells[: last + 1]
        if name not in SMALL:
            code = [i for i, cell in enumerate(self.nb.cells) if cell.cell_type == "code"]
            imports = code[2]  # behind the parameters and those given here
            turn = next(i for i, cell in enumerate(self.nb.cells) if "Your turn" in cell.source)
            self.nb.cells[imports + 1 : turn] = []
        self.client = NotebookClient(self.nb, kernel_name="python3")

    def run(self, source):
        """What a cell prints, run where the notebook has ended."""
        self.nb.cells.append(new_code_cell(source))
        return printed(self.client.execute_cell(self.nb.cells[-1], len(self.nb.cells) - 1))

    def answer(self, number, source):
        """What the check of an exercise says of an answer."""
        self.run(source)
        return self.run(self.nb.cells[tagged(self.nb, f"check-{number}")].source)


def printed(cell):
    """Text that a cell has printed."""
    return "".join(output.get("text", "") for output in cell.outputs)


@pytest.fixture(scope="module", params=WITH_EXERCISES)
def reader(request, tmp_path_factory):
    """One of the notebooks, run as it is, in a kernel that stays for all tests."""
    reader = Reader(request.param, tmp_path_factory.mktemp("exercises"))
    with reader.client.setup_kernel():
        for place, cell in enumerate(reader.nb.cells):
            reader.client.execute_cell(cell, place)
        yield reader


def test_untouched_exercises_are_no_mistake(reader):
    assert exercises(reader.nb) == [1, 2]
    for number in (1, 2):
        said = printed(reader.nb.cells[tagged(reader.nb, f"check-{number}")])
        assert said == f"Exercise {number}: nothing to check yet\n"


def test_solutions_that_unfold_are_right(reader):
    for number in exercises(reader.nb):
        solution = reader.nb.cells[tagged(reader.nb, f"solution-{number}")].source
        said = reader.answer(number, FENCED.search(solution)[1])
        assert said.startswith(f"Exercise {number}: right"), said


def test_wrong_answers_get_a_hint(reader):
    for number in exercises(reader.nb):
        assert WRONG[reader.name][number]
        for answer, hint in WRONG[reader.name][number].items():
            said = reader.answer(number, answer)
            assert said.startswith(f"Exercise {number}: ") and hint in said, said
            assert "right." not in said and "nothing to check" not in said, said


@pytest.mark.parametrize("name", WITH_EXERCISES)
def test_an_exercise_is_a_task_a_place_to_work_a_solution_and_a_check(name):
    nb = SOURCES[name]
    for number in exercises(nb):
        work = tagged(nb, f"exercise-{number}")
        solution, check = (tagged(nb, f"{part}-{number}") for part in ("solution", "check"))
        assert work < solution < check < len(nb.cells)
        kinds = [nb.cells[place].cell_type for place in (work, solution, check)]
        assert kinds == ["code", "markdown", "code"]
        tasks = [cell for cell in nb.cells[:work] if cell.cell_type == "markdown"]
        assert any(f"Exercise {number}" in cell.source for cell in tasks)


@pytest.mark.parametrize(
    ("yours", "said"),
    [
        (None, "nothing to check yet"),
        ([None, None], "nothing to check yet"),
        ([1.0, 2.0005], "right. Well done."),
        ([2.0, 1.0], "not yet. They are swapped."),
        ([2.0, 3.0], "not yet. Think."),
        ([1.0], "not yet. The function does not return what it is asked for."),
        ([1.0, np.nan], "not yet. The function does not return what it is asked for."),
        ([[1], [2, 3]], "not yet. The function does not return what it is asked for."),
        ("one, two", "not yet. The function does not return what it is asked for."),
    ],
)
def test_an_answer_is_told_in_one_sentence(yours, said, capsys):
    judge(3, yours, [1, 2], {"They are swapped.": [2, 1], "Think.": None}, "Well done.")
    assert capsys.readouterr().out == f"Exercise 3: {said}\n"


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (None, "nothing to check yet"),
        ((True, "Seen."), "right. Seen."),
        ((False, "Look again."), "not yet. Look again."),
    ],
)
def test_an_answer_that_is_tried_out_is_told(found, said, capsys):
    check(2, lambda: found)
    assert capsys.readouterr().out == f"Exercise 2: {said}\n"


def test_an_answer_that_raises_is_told_too(capsys):
    check(2, lambda: 1 / 0)
    said = "not yet. It stops with ZeroDivisionError: division by zero"
    assert capsys.readouterr().out == f"Exercise 2: {said}\n"
