"""Simulated ErrP recordings, written in the very format of the real ones.

A generative model, described with its equations in notebook 01: current dipoles in a spherical head
for the brain's responses to feedback, on top of 1/f background activity, occipital alpha, blinks,
saccades, movement artefacts and amplifier noise (`head`).
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple, get_type_hints

import numpy as np
import pandas as pd
import scipy.io

from rlihf_lib.eeg import head, hri
from rlihf_lib.eeg.hri import CHANNELS, SFREQ, SUBJECTS
from rlihf_lib.files import atomic_path, cache_dir, canonical_json, sha256

_VERSION = 1  # raise when the model changes in anything but its parameters
_HEADER = 116  # bytes of text at the start of a MATLAB file
MS = 1e3  # from s


@dataclass(frozen=True)
class Component:
    """One dipole with a Gaussian time course: q(t) = moment exp(-(t - latency)^2 / 2 width^2)."""

    name: str
    latency: float  # s after feedback onset
    width: float  # s, standard deviation
    position: tuple[float, float, float]  # head radii: right, front, up
    direction: tuple[float, float, float]
    moment: float  # nAm


#: Evoked by any feedback: visual P1, N1, and a P3.
_FEEDBACK = (
    Component("P1", 0.105, 0.018, (0.0, -0.70, 0.10), (0.0, -0.9, 0.3), 12.0),
    Component("N1", 0.170, 0.022, (0.0, -0.65, 0.15), (0.0, 0.9, -0.4), 14.4),
    Component("P2", 0.220, 0.030, (0.0, 0.05, 0.60), (0.0, 0.0, 1.0), 5.6),
    Component("P3", 0.400, 0.080, (0.0, -0.35, 0.55), (0.0, -0.3, 1.0), 10.8),
)
#: Evoked by a perceived error, on top of that.
_ERROR = (
    Component("early positivity", 0.164, 0.024, (0.0, 0.10, 0.60), (0.0, 0.2, 1.0), 10.0),
    Component("error negativity", 0.238, 0.024, (0.0, 0.32, 0.52), (0.0, 0.3, -1.0), 30.0),
    Component("error positivity", 0.318, 0.029, (0.0, 0.10, 0.55), (0.0, 0.2, 1.0), 22.0),
    Component("late negativity", 0.428, 0.028, (0.0, 0.05, 0.55), (0.0, 0.1, -1.0), 10.0),
    Component("parietal positivity", 0.420, 0.060, (0.0, -0.50, 0.40), (0.0, -1.0, 0.6), 22.0),
    Component("frontal positivity", 0.550, 0.060, (0.0, 0.42, 0.40), (0.0, 1.0, 0.7), 18.0),
    Component("visual negativity", 0.260, 0.030, (0.0, -0.60, 0.15), (0.0, 1.0, -0.1), 16.0),
)
#: Of each subject, s02 to s13: amplitude of the error response; latency of the whole response, s;
#: oddness, which scales how far the person's components lie from the typical ones.
_PEOPLE = {
    "s02": (0.57, 0.025, 1.00),
    "s03": (0.92, -0.030, 1.10),
    "s04": (1.88, 0.000, 0.30),
    "s05": (0.85, -0.035, 1.80),
    "s06": (0.51, 0.015, 1.60),
    "s07": (0.60, 0.010, 0.70),
    "s08": (0.65, -0.015, 1.00),
    "s09": (0.90, -0.006, 0.60),
    "s10": (0.70, 0.055, 1.25),
    "s11": (0.83, 0.020, 1.30),
    "s12": (0.93, -0.025, 1.80),
    "s13": (1.00, -0.010, 0.50),
}
#: Of each parameter of `Model`: what it is, its symbol in notebook 01, its unit.
_TOLD = {
    "feedback": ("response to any feedback", "λ ± σ, m", "ms, nAm"),
    "error": ("what errors add to it", "λ ± σ, m", "ms, nAm"),
    "jitter": ("scatter of the error response's latency from trial to trial", "SD of τ", "s"),
    "trial_spread": ("scatter of its amplitude from trial to trial", "β", "SD of the logarithm"),
    "lapse": ("errors that evoke nothing", "1 - mean of e", "share"),
    "frequent": ("amplitude where half of the trials are errors", "h", "relative"),
    "subject_latency": ("scatter of a latency between people", "SD of λ", "s, times oddness"),
    "subject_spread": ("of a moment", "SD of log m", "times oddness"),
    "subject_position": ("of a dipole's place", "in g", "head radii, times oddness"),
    "subject_direction": ("of its direction", "in g", "unit vector, times oddness"),
    "background": ("background EEG", "b", "µV RMS"),
    "exponent": ("how fast its power falls with frequency", "γ", ""),
    "background_spread": ("scatter of its sources between people", "in b", "SD of the logarithm"),
    "alpha": ("alpha rhythm at the back of the head", "α", "µV RMS"),
    "noise": ("amplifier and electrode", "n", "µV RMS"),
    "blinks": ("blinks", "in o", "per second"),
    "human_error": ("trials in which the person pressed the wrong key", "", "share"),
    "resolution": ("step of the amplifier", "", "µV"),
    "people": (
        "each person's amplitude / latency shift / oddness: how far components lie from typical",
        "A_s / in λ / times the scatter above",
        "relative / ms / relative",
    ),
    "seed": ("of all random numbers", "", ""),
}
_WITHIN_ACROSS = "calibrated: accuracy within (.91) against across subjects"


@dataclass(frozen=True)
class Model:
    """Parameters of the simulation, each annotated with the origin of its value."""

    feedback: Annotated[
        tuple, "visual P1, N1, P2 and P3 at textbook latencies; the same for both outcomes"
    ] = _FEEDBACK
    error: Annotated[
        tuple,
        "latencies and signs at Cz: Ehrlich & Cheng 2019; sites: error negativity fronto-central, "
        "positivity centro-parietal; moments calibrated: peak over SD 0.59, and how many subjects' "
        "largest peak is the negativity (largest peak at 282 +- 40 ms)",
    ] = _ERROR
    jitter: Annotated[float, "assumed, some 20 ms between trials"] = 0.020  # s, of the latency
    trial_spread: Annotated[float, "assumed"] = 0.35  # log-normal sigma of the trials' amplitudes
    #: Share of errors that evoke nothing.
    lapse: Annotated[float, "assumed; the best subject (.98) leaves no room for more"] = 0.02
    #: Amplitude where half of the trials are errors, relative to a fifth.
    frequent: Annotated[
        float,
        "smaller error potentials where errors are frequent (direction published, size assumed)",
    ] = 0.75
    #: Between subjects, of each component: latency, s; log-normal sigma of its amplitude; position,
    #: head radii; direction, of the unit vector along each axis.
    subject_latency: Annotated[float, "calibrated: spread of the AUROC across subjects"] = 0.014
    subject_spread: Annotated[float, _WITHIN_ACROSS] = 0.40
    subject_position: Annotated[float, _WITHIN_ACROSS] = 0.10
    subject_direction: Annotated[float, _WITHIN_ACROSS] = 0.30
    #: uV, RMS of the 1/f^exponent activity, mean over EEG channels; log-normal sigma of its
    #: generators' power between subjects.
    background: Annotated[float, "usual amplitude of awake EEG, RMS"] = 7.0
    exponent: Annotated[float, "usual slope of the EEG spectrum"] = 1.2
    background_spread: Annotated[float, "assumed"] = 0.8
    #: uV RMS, at the occipital electrodes; of amplifier and electrode, each electrode on its own.
    alpha: Annotated[float, "usual amplitude of alpha with eyes open"] = 4.0
    noise: Annotated[float, "active electrodes and amplifier, below 1 uV"] = 0.5
    blinks: Annotated[float, "9 per minute"] = 0.15  # per second
    #: Share of trials in which the subject pressed the wrong key.
    human_error: Annotated[float, "a few in 500 (documentation of the data set)"] = 0.015
    #: uV, of the amplifier.
    resolution: Annotated[float, "order of a 24-bit amplifier's least significant bits"] = 0.05
    people: Annotated[
        dict,
        "calibrated: gain and oddness of each subject, so that its AUROC across subjects is near "
        "the published one; latencies spread as the published peak (SD 40 ms)",
    ] = field(default_factory=_PEOPLE.copy)
    seed: Annotated[int, "arbitrary, fixed before calibration"] = 20250713


MODEL = Model()


class Trial(NamedTuple):
    """What a trial does to the brain and the eyes."""

    feedback: float  # s, onset
    error: bool
    chance: float  # of errors in the block
    moved: int  # where the feedback moved: left, up, right


def parameter_table(model=MODEL) -> pd.DataFrame:
    """Parameters of a model (rows): meaning, symbol, value, unit, origin of the value (columns)."""
    rows = {}
    for name, hint in get_type_hints(Model, include_extras=True).items():
        value = getattr(model, name)
        if name in ("feedback", "error"):
            parts = [
                (c.name, f"{MS * c.latency:.0f} ± {MS * c.width:.0f}", c.moment) for c in value
            ]
            value = "; ".join(f"{component} {when}, {size:g}" for component, when, size in parts)
        elif name == "people":
            value = "; ".join(f"{k} {g} / {MS * s:+.0f} / {o}" for k, (g, s, o) in value.items())
        meaning, symbol, unit = _TOLD[name]
        rows[name] = (meaning, symbol, value, unit, *hint.__metadata__)
    columns = ["meaning", "symbol", "value", "unit", "origin"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns)


def recording(subject, model=MODEL) -> Path:
    """A subject's `.set`, with its `.fdt` in a folder for the model, made if missing."""
    path = place(subject, model)
    if not path.is_file() or not path.with_suffix(".fdt").is_file():
        write_set(path, *simulate(subject, model))
    return path


def place(subject, model=MODEL) -> Path:
    """Where a subject's `.set` lies, or will lie."""
    key = sha256(canonical_json([_VERSION, asdict(model)]))[:12]
    return cache_dir() / f"simulated-{key}" / f"{subject}_cursor.set"


def simulate(subject, model=MODEL) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """Recording of a subject, ``s02`` to ``s13``: data as in `head`, float32 at 256 Hz; events.

    Of an event, the 1-based, fractional latency in samples, and the name.
    """
    # One stream for each part, so that a parameter of one leaves the others as they were.
    rng = np.random.default_rng([model.seed, SUBJECTS.index(subject)])
    person, course, noise, eyes = rng.spawn(4)
    trials, events, duration = protocol(course, model)
    data = head.background(int(duration * SFREQ), model, person, noise)
    head.add_responses(data, trials, subject, model, (person, course))
    head.add_eyes(data, trials, model, eyes)
    head.add_movements(data, eyes)
    # Rounding to the amplifier's resolution also makes the file the same on every machine: what
    # processors disagree on is far below it.
    data = np.round(data / model.resolution) * model.resolution
    return data.astype(np.float32), events


def protocol(rng, model) -> tuple[list[Trial], list[tuple[float, str]], float]:
    """The course of a recording: its trials, its events as in `simulate`, its duration in s."""
    chances = rng.permutation(np.repeat([0.2, 0.5], hri.N_BLOCKS // 2))
    trials, events, start = [], [], 5.0
    for chance in chances:
        for _ in range(hri.N_TRIALS_PER_BLOCK):
            trial, times, start = _trial(rng, model, chance, start)
            trials.append(trial)
            events += [(round(time, 3) * SFREQ + 1, name) for time, name in times]
        start += 8.0
    return trials, events, start


def _trial(rng, model, chance, start):
    """A trial, its events as (time in s, name), and when the next one starts."""
    pressed = moved = target = rng.integers(3)
    stimulus = start + rng.uniform(0.3, 0.5)
    key = stimulus + min(0.25 + rng.lognormal(np.log(0.25), 0.35), 1.2)
    feedback = key + rng.uniform(0.015, 0.035)
    outcome = hri.CORRECT
    if rng.random() < model.human_error:
        pressed = moved = (target + rng.integers(1, 3)) % 3
        outcome = hri.HUMAN_ERROR
    elif rng.random() < chance:
        moved, outcome = (target + rng.integers(1, 3)) % 3, hri.MACHINE_ERROR
    end = feedback + rng.uniform(1.75, 1.85)
    # The amplifier sampled at 1000 Hz; the files' latencies are fractions of 1/256 s.
    feedback = round(feedback, 3)
    times = [
        (stimulus, hri.STIMULI[target]),
        (key, hri.RESPONSES[pressed]),
        (feedback, hri.FEEDBACKS[moved]),
        (feedback + 0.001, outcome),
        (feedback + 1.0, hri.FRAME),
        (feedback + 1.4, hri.BACK),
        (end, hri.TRIAL_END),
    ]
    trial = Trial(feedback, outcome == hri.MACHINE_ERROR, chance, moved)
    return trial, times, end + rng.uniform(0.1, 0.2)


def write_set(path, data, events) -> None:
    """Write a recording, as `simulate` gives it, as an EEGLAB `.set` with its data in a `.fdt`."""
    n_channels, n_samples = data.shape
    with atomic_path(path.with_suffix(".fdt")) as temporary:
        np.asarray(data, "<f4").T.tofile(temporary)
    rows = [(float(latency), name) for latency, name in events]
    eeg = {
        "setname": path.stem,
        "filename": path.name,
        "data": path.with_suffix(".fdt").name,
        "datfile": path.with_suffix(".fdt").name,
        "nbchan": float(n_channels),
        "pnts": float(n_samples),
        "trials": 1.0,
        "srate": SFREQ,
        "xmin": 0.0,
        "xmax": (n_samples - 1) / SFREQ,
        "ref": "TP9 TP10",
        "chanlocs": np.array([(name,) for name in CHANNELS], [("labels", object)]),
        "event": np.array(rows, [("latency", object), ("type", object)]),
        "comments": "Simulated by rlihf_lib; not a recording of a person.",
    }
    # The .set comes last: where it is, the .fdt is complete.
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        scipy.io.savemat(file, {"EEG": eeg}, format="5", do_compression=True, oned_as="row")
        # scipy writes the time into the header, which would make every file different.
        file.seek(0)
        file.write(b"MATLAB 5.0 MAT-file, rlihf_lib simulated recording".ljust(_HEADER))
