"""Films of rollouts, and their steps as figures."""

import subprocess

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from imageio_ffmpeg import get_ffmpeg_exe, read_frames
from PIL import Image

from rlihf_lib.report import films
from rlihf_lib.rl.evaluation import record
from rlihf_lib.rl.feedback import perfect_table
from rlihf_lib.rl.rewards import errp_reward
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.rl.training import training_reward
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.scripted import expert_action, sit_still

PERSON = pd.DataFrame(
    {"epoch": range(4), "label": [0, 0, 1, 1], "p_error": [0.125, 0.25, 0.5, 0.75]}
)
BLACK = np.zeros((films.SCENE, films.ALONE, 3), np.uint8)


def take(env, act, condition="sparse", rows=PERSON):
    feedback = {"subject": "s02", "w_hf": 0.5} if condition == "rlihf" else {}
    config = RunConfig(condition, 0, 1000, 1000, **feedback)
    reward = training_reward(env, config, rows, np.random.default_rng(0))
    recording = record(env, act, 1)
    return recording, films.told(recording, reward)


@pytest.fixture(scope="module")
def env():
    environment = PickPlaceEnv(100)
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def idle():
    """A robot that stands still for 1.2 s."""
    return take(PickPlaceEnv(12), sit_still)


@pytest.fixture
def rendered(monkeypatch):
    """Stand for the renderer: grey scenes, each lighter than the one before; remember the seeds."""
    seeds = []

    def render(qpos, seed, width, height):
        seeds.append(seed)
        shades = np.linspace(40, 200, len(qpos)).astype(np.uint8)
        return np.broadcast_to(shades[:, None, None, None], (len(qpos), height, width, 3))

    monkeypatch.setattr(films, "render_rollout", render)
    return seeds


def test_the_robot_is_paid_what_the_observer_saw_and_the_decoder_said(env):
    recording, table = take(env, expert_action, "rlihf")
    assert len(table) == len(recording.moments) and recording.success
    said = dict(zip(PERSON["p_error"], PERSON["label"], strict=True))
    seen = table["p_error"].map(said).map({0: "correct", 1: "error"})
    assert (table["seen"] == seen).all(), "each class is answered by epochs of its own"
    assert (table.loc[table["right"] == 1, "seen"] == "correct").all()
    assert (table.loc[table["right"] == 0, "seen"] == "error").all()
    paid = 0.5 * errp_reward(table["p_error"])
    np.testing.assert_allclose(table["reward"][:-1], paid[:-1])
    assert table["reward"].iloc[-1] > 10, "what is to come is paid at the end"


def test_watching_does_not_change_what_sparse_reward_pays(env, idle):
    _, table = idle
    assert (table["reward"] == 0).all() and (table["seen"] == "error").all()
    assert set(take(env, sit_still, rows=perfect_table())[1]["p_error"]) == {1.0}


def test_a_film_is_rendered_anew_only_if_what_it_shows_has_changed(study, idle, rendered):
    source = study.decoder / "scores.csv"

    def save():
        takes = {"dense": idle}
        return films.save_film(takes, "s02", study, "film_dense", "03_policy_training", [source])

    for text in ("subject,auroc\n", "subject,auroc\n", "subject,auroc\ns02,0.5\n"):
        source.write_text(text)
        gif = save()
    assert rendered == [1, 1]
    first = [gif.with_suffix(suffix).read_bytes() for suffix in films.ENCODERS]
    gif.with_suffix(".mp4").unlink()
    save()
    assert len(rendered) == 3, "half a film is none"
    assert [gif.with_suffix(s).read_bytes() for s in films.ENCODERS] == first, "equal data"
    study.figures = study.out / "yours"
    assert save() == gif and len(rendered) == 3, "a reader gets what is shipped"


def test_a_film_shows_every_state_as_it_was_rendered_and_holds_the_last(study, idle, rendered):
    before = plt.get_fignums()
    gif = films.save_film({"sparse": idle}, "s02", study, "film_sparse", "03_policy_training", [])
    assert plt.get_fignums() == before
    with Image.open(gif) as film:
        assert (film.size, film.n_frames) == ((640, 480), 13)
        film.seek(12)
        assert film.info["duration"] == 1000
    shades = [scene.mean() for scene in films.scenes_of(gif)]
    np.testing.assert_allclose(shades, np.linspace(40, 200, 13).astype(int), atol=2)
    frames = read_frames(gif.with_suffix(".mp4"))
    about = next(frames)
    assert about["size"] == (640, 480) and about["pix_fmt"].startswith("yuv420p")
    assert len(list(frames)) == 13 + 10
    done = subprocess.run([get_ffmpeg_exe(), "-i", gif.with_suffix(".mp4")], capture_output=True)
    assert b"h264" in done.stderr


def test_films_stand_side_by_side_and_the_shorter_one_waits(study, idle, env, rendered):
    takes = {"sparse": idle, "dense": take(env, expert_action, "dense")}
    gif = films.save_film(takes, "s02", study, "film_compared", "04_metrics_tables", [])
    pictures = films.scenes_of(gif)
    assert pictures[0].shape[1] == 2 * films.ABREAST
    assert len(pictures) == -(-(1 + len(takes["dense"][1])) // 2) > 7, "every other state"
    left, right = (slice(0, films.ABREAST), slice(films.ABREAST, None))
    assert pictures[6][:, left].mean() == pytest.approx(pictures[-1][:, left].mean(), abs=2)
    assert pictures[6][:, right].mean() < pictures[-1][:, right].mean() - 20
    assert pictures[-1][:, right].mean() == pytest.approx(200, abs=2), "the last is shown"


def test_a_step_shows_its_scene_and_how_far_the_rollout_is(idle, env):
    scenes = [BLACK + np.uint8(10 * i) for i in range(13)]
    figure = films.rollout_figure({"sparse": idle}, scenes, env, 7, "a decoder")
    scene, *strips = figure.subfigs[0].axes
    assert scene.images[0].get_array().max() == 70
    for ax in strips:
        (*bars, veil) = ax.patches
        assert veil.get_x() == pytest.approx(0.7), "what comes later is faint"
        assert len(bars) == 12
    words = figure.texts[-1].get_text()
    assert words.startswith("0.7 s, stage: reach") and "reward = 0.00" in words


def test_without_opengl_the_path_so_far_is_drawn_from_above(env):
    recording, table = take(env, expert_action, "dense")
    figure = films.rollout_figure({"dense": (recording, table)}, None, env, 9, "a decoder")
    drawn = [line.get_xydata() for ax in figure.subfigs[0].axes for line in ax.lines]
    assert any(np.array_equal(path, recording.hand[:10, 1::-1]) for path in drawn)


def test_frames_are_rendered_of_every_state(env):
    recording = record(PickPlaceEnv(3), expert_action, 1)
    scenes = films.render_rollout(recording.qpos, 1, 320, 160)
    if scenes is None:
        pytest.skip("no OpenGL library here")
    assert scenes.shape == (4, 160, 320, 3)
    assert scenes[0].std() > 20 and np.abs(scenes[0] - scenes[3].astype(float)).max() > 50
