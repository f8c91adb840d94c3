"""Films of rollouts: below the scene what observer, decoder and reward say of every step."""

import subprocess
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from imageio_ffmpeg import get_ffmpeg_exe
from matplotlib.figure import Figure
from PIL import Image, ImageSequence

from rlihf_lib.files import atomic_path
from rlihf_lib.report.figures_task import top_view
from rlihf_lib.report.saving import caption, enter, hash_sources, manifest
from rlihf_lib.report.style import COLORS, color, label
from rlihf_lib.rl.evaluation import Recording
from rlihf_lib.rl.rewards import TrainingReward
from rlihf_lib.task.gym_env import PickPlaceEnv
from rlihf_lib.task.rendering import render_rollout

STEPS, STEP = 80, 0.1  # control steps of a film at most, and seconds of each
# Pixels: width of a scene alone and of each of several; heights; left of the strips; per inch.
ALONE, ABREAST, TITLE, SCENE, HEIGHT, MARGIN, DPI = 640, 420, 28, 304, 480, 76, 100
#: Of ffmpeg, by suffix. The last picture stays for a second; dithered ones would flicker.
ENCODERS = {
    ".gif": "-lavfi split[a][b];[a]palettegen=96[p];[b][p]paletteuse=dither=none -final_delay 100",
    ".mp4": "-vf tpad=stop_mode=clone:stop_duration=1 -c:v libx264 -pix_fmt yuv420p -crf 20",
}
BITEXACT = "-map_metadata -1 -fflags +bitexact -flags:v +bitexact -threads 1"  # no dates, versions


def told(recording: Recording, reward: TrainingReward) -> pd.DataFrame:
    """Say what people and learner are told of each step of a film, by a reward with an observer.

    Columns right, P(right) of the observer; seen, "correct" or "error", what they perceive;
    p_error, decoded from an epoch of that class; reward.
    """
    rows, observer = [], reward.observer
    for moment in recording.moments[:STEPS]:
        errors = observer.errors_seen
        paid, p_error = reward.judge(moment)
        seen = "error" if observer.errors_seen > errors else "correct"
        rows.append((1 - observer.looks_wrong(moment), seen, p_error, paid))
    return pd.DataFrame(rows, columns=["right", "seen", "p_error", "reward"])


def save_film(takes: dict, person: str, study, name: str, notebook: str, sources) -> Path | None:
    """Save rollouts side by side as GIF and mp4; other arguments as of `save_figure`.

    `takes` are a `Recording` and what is `told` of it, by group; `person`, whose decoder tells it.
    Rendering takes half a minute without a graphics card, so a film of the same sources is kept.
    Returns the GIF; None where no OpenGL library can render it.
    """
    hashes = hash_sources(study, name, sources)
    for figures in (study.shipped_figures, study.figures):
        gif, known = figures / f"{name}.gif", manifest(figures).get(name, {}).get("sources")
        if known == hashes and all(gif.with_suffix(suffix).is_file() for suffix in ENCODERS):
            return gif
    width, scenes = ALONE if len(takes) == 1 else ABREAST, []
    for run, _ in takes.values():
        scene = render_rollout(run.qpos[: STEPS + 1], run.seed, width, SCENE)
        if scene is None:
            return None
        scenes.append(scene)
    says = f"p(error) of {person}'s epochs: green, seen as right; purple, seen as wrong"
    figure, show = _sheet(takes, scenes, caption(study, says))
    for artist in show(0):
        artist.set_animated(True)  # drawn over the rest, which is drawn once
    figure.canvas.draw()
    still, pictures = figure.canvas.copy_from_bbox(figure.bbox), []
    for state in range(max(map(len, scenes))):
        figure.canvas.restore_region(still)
        for artist in show(state):
            figure.draw_artist(artist)
        pictures.append(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy())
    plt.close(figure)
    for suffix in ENCODERS:
        # Several scenes at half the rate, or the notebook that shows the GIF gets too large.
        every = 2 if suffix == ".gif" and len(takes) > 1 else 1
        _encode(gif.with_suffix(suffix), pictures[::-every][::-1], every * STEP)
    enter(study, name, notebook, hashes)
    return gif


def _encode(path, pictures, seconds):
    height, width, _ = pictures[0].shape
    raw = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {1 / seconds:g} -i -"
    options = f"-loglevel error {raw} {ENCODERS[path.suffix]} {BITEXACT} -y".split()
    with atomic_path(path) as temporary:
        command = [get_ffmpeg_exe(), *options, str(temporary)]
        frames = b"".join(picture.tobytes() for picture in pictures)
        done = subprocess.run(command, input=frames, stderr=subprocess.PIPE)
        if done.returncode:
            raise OSError(f"ffmpeg: {done.stderr.decode(errors='replace').strip()[-200:]}")


def _sheet(takes, scenes, says):
    """Lay out a film; also return what shows a state of it, with all that comes later faint."""
    span = STEP * max(len(table) for _, table in takes.values())
    width, shown = ALONE if len(takes) == 1 else ABREAST, []
    figure = plt.figure(figsize=(width * len(takes) / DPI, HEIGHT / DPI), dpi=DPI, layout="none")
    under = {"left": MARGIN / width, "right": 1 - 16 / width, "hspace": 0.3}
    under |= {"bottom": 34 / HEIGHT, "top": 1 - (TITLE + SCENE + 9) / HEIGHT}
    parts = figure.subfigures(1, len(takes), squeeze=False, wspace=0)[0]
    for part, (group, (recording, table)), scene in zip(parts, takes.items(), scenes, strict=True):
        last = recording.moments[len(table) - 1]
        words = "can placed" if last.success else "can lost" if last.lost else "not placed"
        words = f"{label(group)}: {words} after {STEP * len(table):.1f} s"
        part.text(
            8 / width, 1 - TITLE / 2 / HEIGHT, words, color=color(group), size=10, weight="bold",
            va="center",
        )  # fmt: skip
        ax = part.add_axes((0, 1 - (TITLE + SCENE) / HEIGHT, 1, SCENE / HEIGHT))
        ax.axis("off")
        image = ax.imshow(scene[0], aspect="auto", interpolation="none")
        strips = part.subplots(3, gridspec_kw=under)
        _draw_strips(strips, table, span)
        shown.append((scene, image, [ax.axvspan(0, span, fc="#FFFFFFB0", ec="k") for ax in strips]))
    figure.text(0.5, 2 / HEIGHT, says, size=7, color="#555555", ha="center", va="bottom")

    def show(state):
        for scene, image, veils in shown:
            now = min(state, len(scene) - 1)
            image.set_data(scene[now])
            for veil in veils:
                veil.set_x(STEP * now)
        return [artist for _, image, veils in shown for artist in (image, *veils)]

    return figure, show


def _draw_strips(axes, table, span):
    time = STEP * (0.5 + np.arange(len(table)))
    top = max(1.0, table["reward"][:-1].max())  # what is paid at the end goes beyond
    strips = {
        "observer\nP(right)": ("right", COLORS["correct"], 0, 1),
        "decoder\np(error)": ("p_error", [COLORS[seen] for seen in table["seen"]], 0, 1),
        "reward": ("reward", "#444444", min(table["reward"].min(), 0), top),
    }
    for ax, (words, (column, shade, low, high)) in zip(axes, strips.items(), strict=True):
        ax.bar(time, table[column], 0.8 * STEP, color=shade, lw=0)
        ax.set(xlim=(0, span), ylim=(low, high), yticks=[0, 1])
        ax.set_ylabel(words, rotation=0, ha="right", va="center", size=7)
        ax.tick_params(labelsize=7, labelbottom=ax is axes[-1], pad=1)
        ax.grid(False)
    ax.xaxis.set_major_formatter("{x:g} s")
    if (last := table["reward"].iloc[-1]) > top:
        ax.text(time[-1] - STEP, top, f"{last:.1f}", size=7, ha="right", va="top")


def scenes_of(gif: Path) -> list[np.ndarray]:
    """Read the scene in every state, RGB, from the film of one take."""
    with Image.open(gif) as film:
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    return [frame[TITLE : TITLE + SCENE] for frame in frames]


def rollout_figure(take: dict, scenes, env: PickPlaceEnv, step: int, says: str) -> Figure:
    """Draw the film of one take at a step, with what people see in it, over a caption.

    `scenes` are `scenes_of` its film; without any, the path so far is drawn from above, in `env`.
    """
    ((group, (recording, table)),) = take.items()
    empty = [np.ones((SCENE, ALONE, 3))] * (step + 1)
    figure, show = _sheet(take, [scenes or empty], says)
    show(step)
    if not scenes:
        env.reset(seed=recording.seed)
        right = (0.3, 1 - (TITLE + SCENE) / HEIGHT, 0.7, SCENE / HEIGHT)
        ax = figure.subfigs[0].add_axes(right)
        top_view(env, ax)
        ax.plot(*recording.hand[: step + 1, 1::-1].T, color=color(group))
        ax.axis("off")
    moment, said = recording.moments[step - 1], table.iloc[step - 1]
    words = [
        f"{STEP * step:.1f} s, stage: {recording.stages[step - 1]}",
        f"path left: {100 * moment.remaining:.1f} cm",
        f"gained: {100 * max(moment.best - moment.remaining, 0):.1f} cm",
        f"clearance: {100 * moment.clearance:.1f} cm",
        f"P(right) = {said.right:.2f}, seen: {said.seen}",
        f"p(error) = {said.p_error:.2f}, reward = {said.reward:.2f}",
    ]
    box = {"fc": "white", "ec": "none", "alpha": 0.7}
    place = 12 / ALONE, 1 - (TITLE + 10) / HEIGHT
    figure.text(*place, "\n".join(words), size=8, linespacing=1.5, va="top", bbox=box)
    return figure
