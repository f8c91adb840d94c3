"""How far a study is: what is done, what is missing, how long the rest will take."""

import json

from dask.system import CPU_COUNT

from rlihf_lib import progress
from rlihf_lib.rl.runs import is_done

# Measured on 2 cores of a shared cloud machine with one thread per process; measured times of
# this study's own runs are used as soon as there are any.
SECONDS_PER_STEP = 0.007
SECONDS_PER_FOLD = 40
SECONDS_PER_NOTEBOOK = 15
N_EXECUTIONS = 7  # five notebooks, 03 once per condition


def status(study, workers=0):
    """Say for every stage what is done, what is missing, and how long the rest will take.

    Parameters
    ----------
    study : Study
    workers : int
        Worker processes assumed; 0 = one per core.

    Returns
    -------
    list of dict
        Keys stage, done, missing (counts), what (unit) and seconds (estimate for the missing).
    """
    workers = workers or CPU_COUNT
    rows = []
    figures = _manifest(study)
    rows.append(_drawing(study, figures, "01_dataset_preprocessing"))
    rows.append(_decoder_status(study))
    counted = set()
    for stage in ("sparse", "tuned", "dense", "rlihf", "controls"):
        rows.append(_runs_status(study, stage, f"03_policy_training {stage}", workers, counted))
    rows.append(_drawing(study, figures, "04_metrics_tables"))
    rows.append(_runs_status(study, "ablation", "05_whf_ablation", workers, counted))
    return rows


def print_status(study, workers=0):
    """Print `status` as a table, with the total time."""
    rows = status(study, workers)
    print(f"study {study.name} in {study.out}")
    print(f"{'stage':<28}{'done':>6}{'missing':>9}  {'':<9}time for the rest")
    for row in rows:
        rest = f"about {progress.duration(row['seconds'])}" if row["missing"] else "-"
        print(f"{row['stage']:<28}{row['done']:>6}{row['missing']:>9}  {row['what']:<9}{rest}")
    total = sum(row["seconds"] for row in rows) + SECONDS_PER_NOTEBOOK * N_EXECUTIONS
    print(
        f"everything takes about {progress.duration(total)}, "
        f"of which {progress.duration(SECONDS_PER_NOTEBOOK * N_EXECUTIONS)} is drawing"
    )


def _manifest(study):
    path = study.figures / "manifest.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def _drawing(study, figures, notebook):
    done = sum(entry["notebook"] == notebook for entry in figures.values())
    return {
        "stage": notebook,
        "done": done,
        "missing": 0 if done else 1,
        "what": "figures" if done else "notebook",
        "seconds": 0 if done else SECONDS_PER_NOTEBOOK,
    }


def _decoder_status(study):
    done = len(list((study.decoder / "folds").glob("*/")))
    if (study.decoder / "p_error.csv").is_file():
        done = study.p_error()["subject"].nunique()
        missing = 0
    else:
        missing = max((study.profile.n_subjects or 12) - done, 1)
    return {
        "stage": "02_loso_decoder",
        "done": done,
        "missing": missing,
        "what": "folds",
        "seconds": missing * SECONDS_PER_FOLD,
    }


def _runs_status(study, stage, title, workers, counted):
    """Count runs; those that an earlier stage counted as missing take no time a second time."""
    profile = study.profile
    try:
        configs = study.run_configs(stage)
    except FileNotFoundError:  # the decoder says later who the policy subjects are
        people = profile.n_ablation_subjects if stage == "ablation" else profile.n_policy_subjects
        people, n_weights = people or 12, len(profile.weights)
        missing = n_new = {
            "rlihf": people * len(profile.seeds),
            "controls": len(profile.supplementary_seeds) + 2 * len(profile.control_seeds),
            "ablation": people * n_weights * len(profile.ablation_seeds),
        }[stage]
        if stage == "ablation":
            n_new -= people * len(profile.ablation_seeds)  # at the main weight
        done = 0
    else:
        to_do = [config for config in configs if not is_done(config, study.runs)]
        n_new = len([config for config in to_do if config not in counted])
        counted.update(to_do)
        done, missing = len(configs) - len(to_do), len(to_do)
    seconds = n_new * profile.total_steps * _seconds_per_step(study) / max(1, min(workers, n_new))
    return {"stage": title, "done": done, "missing": missing, "what": "runs", "seconds": seconds}


def _seconds_per_step(study):
    """Mean over the study's finished runs; a default before there are any."""
    seconds, steps = 0.0, 0
    for path in study.runs.glob("*/provenance.json"):
        wall = json.loads(path.read_text(encoding="utf-8")).get("wall_seconds")
        config = path.with_name("config.json")
        if wall and config.is_file():
            seconds += wall
            steps += json.loads(config.read_text(encoding="utf-8"))["total_steps"]
    return seconds / steps if steps else SECONDS_PER_STEP
