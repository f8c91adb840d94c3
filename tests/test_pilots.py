"""The pilots stay apart from the studies, and show what is done so far."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from rlihf_lib import pilots
from rlihf_lib.report.evaluations import group_of, read_runs
from rlihf_lib.rl.sweep import is_done
from rlihf_lib.study import PROFILES, TUNED, Study

STUDY = Study("quick")


def evaluations(configs):
    """Runs that place the can more often the longer they have been trained."""
    steps = np.arange(0, pilots.STEPS + 1, pilots.EVAL_EVERY)
    frames = [
        pd.DataFrame(
            {
                "step": steps, "rollout": 0, "success": steps / pilots.STEPS,
                **dict.fromkeys(pilots.COLUMNS[1:], 0.5), "run": config.run_id,
                "group": group_of(config), "subject": config.subject,
            }
        )
        for config in configs
    ]  # fmt: skip
    return pd.concat(frames, ignore_index=True)


def test_pilots_use_seeds_that_no_study_uses_and_share_its_settings():
    configs = pilots.run_configs(STUDY)
    assert len({config.run_id for config in configs}) == len(configs)
    used = {seed for profile in PROFILES.values() for seed in profile.seeds}
    assert not used & {config.seed for config in configs}
    assert {config.condition for config in configs} == {"sparse", "dense", "rlihf"}
    (config, *_) = STUDY.run_configs("dense")
    settings = {(config.sac, config.patience), (TUNED["sac"], TUNED["patience"])}
    tried = [c for c in configs if (c.sac, c.patience) not in settings]
    assert {c.run_id.rpartition("-")[0] for c in tried} == {"sparse-patience1000-discount0.99"}


def test_summary_averages_the_last_third_of_training():
    configs = pilots.run_configs(STUDY)[:2]
    table = pilots.summary(evaluations(configs))
    assert table["run"].tolist() == [config.run_id for config in configs]
    late = np.arange(110_000, 150_001, 10_000) / 150_000
    np.testing.assert_allclose(table["success"], late.mean(), atol=1e-3)


def test_shipped_summary_is_that_of_the_shipped_runs():
    folder = STUDY.out / "results" / "pilots"
    configs = pilots.run_configs(STUDY)
    done = [config for config in configs if is_done(config, folder / "runs")]
    shipped = pd.read_csv(folder / "summary.csv", keep_default_na=False)
    expected = pilots.summary(read_runs(done, folder / "runs"))
    pd.testing.assert_frame_equal(shipped, expected, check_dtype=False)


def test_learning_curves_show_the_runs_there_are():
    configs = pilots.run_configs(STUDY)
    fig = pilots.learning_curves(evaluations(configs[:7]), STUDY.scores())
    for ax in fig.axes[:2]:
        assert ax.get_legend_handles_labels()[1] == [
            "RL dense, n = 3", "RLIHF, ideal decoder, n = 3", "RL sparse, n = 1",
        ]  # fmt: skip
    plt.close(fig)


def test_a_wrong_number_of_workers_is_refused_before_anything_runs(capsys):
    with pytest.raises(SystemExit):
        pilots.main(["--workers", "-1"])
    assert "'-1' is not a number of processes" in capsys.readouterr().err
