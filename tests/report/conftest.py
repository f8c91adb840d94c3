"""Hand-made runs: a smoke study on disk, and the paper's size in memory."""

import json

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from rlihf_lib.files import write_sums
from rlihf_lib.report.evaluations import derive, group_of
from rlihf_lib.report.style import use_style
from rlihf_lib.rl.feedback import person_and_control
from rlihf_lib.rl.runs import RunConfig, SACSettings, write_run
from rlihf_lib.study import Study

matplotlib.use("agg")
use_style()

STEPS = (0, 1000, 2000, 3000)
LEVEL = {"sparse": 0.0, "dense": 1.0, "rlihf": 0.5}


@pytest.fixture(autouse=True)
def closed():
    """Close what was drawn."""
    yield
    plt.close("all")


@pytest.fixture
def legend():
    """Lines of the legend of axes, by name."""
    return lambda ax: {line.get_label(): line for line in ax.lines if line.get_label()[0] != "_"}


@pytest.fixture
def study(tmp_path):
    """A smoke study whose runs are made by hand: success 0, 1 and 0.5 after the first third."""
    study = Study("smoke", out=tmp_path)
    study.decoder.mkdir(parents=True)
    scores = pd.DataFrame({"subject": ["s02", "s03", "s04"], "auroc": [0.9, 0.7, 0.8]})
    scores = scores.assign(accuracy_online=0.8, balanced_accuracy=0.75)
    scores.to_csv(study.decoder / "scores.csv", index=False)
    people = [who for who in scores["subject"] for _ in range(2)]
    table = pd.DataFrame({"subject": people, "epoch": [0, 1] * 3, "label": [1, 0] * 3})
    table["p_error"] = 0.6
    table.to_csv(study.decoder / "p_error.csv", index=False)
    write_sums(study.decoder, ["p_error.csv", "scores.csv"])
    for stage in ("sparse", "dense", "ablation"):
        for config in study.run_configs(stage):
            rows = [
                {
                    "step": step, "rollout": rollout, "return": 10.0 * step / 1000,
                    "success": float(step > 1000 and rollout < 2 * LEVEL[config.condition]),
                    "path_efficiency": 0.5, "path_deviation": 0.25, "collisions": rollout,
                    "min_clearance": 0.03, "completed": 0.5,
                }
                for step in STEPS
                for rollout in (0, 1)
            ]  # fmt: skip
            recorded = json.dumps({"hash": config.hash}).encode()
            table = pd.DataFrame(rows).to_csv(index=False).encode()
            write_run(config, study.runs, {"eval.csv": table, "config.json": recorded})
    return study


PEOPLE = [f"s{number:02d}" for number in range(2, 14)]
SIZES = {"total_steps": 3000, "eval_every": 1000}


def feedback(subject, seed, w_hf=0.7):
    """Config of a run with feedback."""
    return RunConfig("rlihf", seed, eeg="simulated", subject=subject, w_hf=w_hf, **SIZES)


def evaluations(configs, people=PEOPLE):
    """Runs that reach a late success of their own: people's are the better the later their name."""
    rng, frames = np.random.default_rng(0), []
    for config in configs:
        person = person_and_control(config.subject)[0]
        skill = people.index(person) / (len(people) - 1) if person in people else 1.0
        level = {"sparse": 0.02, "dense": 0.9, "rlihf": 0.2 + 0.6 * skill + 0.1 * config.w_hf}
        late = min(level[config.condition] * (0.02 if "-" in config.subject else 1), 0.95)
        late += 0.05 * rng.random()
        frames.append(
            pd.DataFrame(
                {
                    "run": config.run_id, "group": group_of(config), "person": person,
                    "condition": config.condition, "subject": config.subject, "w_hf": config.w_hf,
                    "seed": config.seed, "step": STEPS, "rollout": 0,
                    "return": np.array([0, 100, 500, 900]) * late,
                    "success": np.array([0, 0.1, 0.5, 1]) * late,
                    "path_efficiency": late, "path_deviation": 0.3 - 0.2 * late,
                    "collisions": 1 - late, "min_clearance": 0.02 + 0.01 * late,
                    "completed": late,
                }
            )
        )  # fmt: skip
    return derive(pd.concat(frames, ignore_index=True))


@pytest.fixture(scope="session")
def scores():
    """Scores of twelve decoders; AUROC rises from s02 to s13."""
    auroc = np.linspace(0.7, 0.98, 12)
    table = pd.DataFrame({"subject": PEOPLE, "auroc": auroc, "balanced_accuracy": auroc - 0.1})
    return table.assign(accuracy_online=auroc - 0.05)


@pytest.fixture(scope="session")
def runs():
    """Sparse, dense and RLIHF of the paper's size: 12 people, 5 seeds."""
    seeds = range(5)
    baselines = [RunConfig(c, seed, **SIZES) for c in ("sparse", "dense") for seed in seeds]
    return evaluations([*baselines, *(feedback(p, seed) for p in PEOPLE for seed in seeds)])


@pytest.fixture(scope="session")
def weighed():
    """RLIHF of 12 people and 5 seeds at three weights."""
    weights = (0.1, 0.4, 0.7)
    return evaluations([feedback(p, seed, w) for w in weights for p in PEOPLE for seed in range(5)])


@pytest.fixture(scope="session")
def supplement():
    """Five seeds of each control, those with a person's p(error) of s08."""
    settings = {"patience": 1000, "sac": SACSettings(discount=0.98)}
    seeds = range(5)
    tuned = [RunConfig("sparse", seed, **SIZES, **settings) for seed in seeds]
    subjects = ("ideal", "s08-mean", "s08-shuffled")
    return evaluations([*tuned, *(feedback(s, seed) for s in subjects for seed in seeds)])
