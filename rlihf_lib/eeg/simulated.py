"""Simulated ErrP recordings, written in the very format of the real ones.

A generative model, described with its equations in notebook 01: current dipoles in a spherical head
for the brain's responses to feedback, on top of 1/f background activity, occipital alpha, blinks,
saccades, movement artefacts and amplifier noise.
"""

import io
from dataclasses import asdict, dataclass, field
from functools import lru_cache

import numpy as np
import scipy.fft
import scipy.io

from rlihf_lib.eeg import dataset
from rlihf_lib.eeg.dataset import CHANNELS, SFREQ, SUBJECTS
from rlihf_lib.eeg.head import lead_field
from rlihf_lib.files import atomic_path, canonical_json, sha256

_VERSION = 1  # raise when the model changes in anything but its parameters


@dataclass(frozen=True)
class Component:
    """One dipole with a Gaussian time course: q(t) = moment exp(-(t - latency)^2 / 2 width^2)."""

    name: str
    latency: float  # s after feedback onset
    width: float  # s, standard deviation
    position: tuple[float, float, float]  # head radii: right, front, up
    direction: tuple[float, float, float]
    moment: float  # nAm


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


@dataclass(frozen=True)
class Model:
    """Parameters of the simulation; notebook 01 says where each comes from."""

    #: Evoked by any feedback: visual P1, N1, and a P3.
    feedback: tuple[Component, ...] = (
        Component("P1", 0.105, 0.018, (0.0, -0.70, 0.10), (0.0, -0.9, 0.3), 12.0),
        Component("N1", 0.170, 0.022, (0.0, -0.65, 0.15), (0.0, 0.9, -0.4), 14.4),
        Component("P2", 0.220, 0.030, (0.0, 0.05, 0.60), (0.0, 0.0, 1.0), 5.6),
        Component("P3", 0.400, 0.080, (0.0, -0.35, 0.55), (0.0, -0.3, 1.0), 10.8),
    )
    #: Evoked by a perceived error, on top of `feedback`.
    error: tuple[Component, ...] = (
        Component("early positivity", 0.164, 0.024, (0.0, 0.10, 0.60), (0.0, 0.2, 1.0), 10.0),
        Component("error negativity", 0.238, 0.024, (0.0, 0.32, 0.52), (0.0, 0.3, -1.0), 30.0),
        Component("error positivity", 0.318, 0.029, (0.0, 0.10, 0.55), (0.0, 0.2, 1.0), 22.0),
        Component("late negativity", 0.428, 0.028, (0.0, 0.05, 0.55), (0.0, 0.1, -1.0), 10.0),
        Component("parietal positivity", 0.420, 0.060, (0.0, -0.50, 0.40), (0.0, -1.0, 0.6), 22.0),
        Component("frontal positivity", 0.550, 0.060, (0.0, 0.42, 0.40), (0.0, 1.0, 0.7), 18.0),
        Component("visual negativity", 0.260, 0.030, (0.0, -0.60, 0.15), (0.0, 1.0, -0.1), 16.0),
    )
    jitter: float = 0.020  # s, latency from trial to trial
    trial_spread: float = 0.35  # log-normal sigma of the amplitude from trial to trial
    lapse: float = 0.02  # share of errors that evoke nothing
    frequent: float = 0.75  # amplitude where half of the trials are errors, relative to a fifth
    subject_latency: float = 0.014  # s, latency of each component between subjects
    subject_spread: float = 0.40  # log-normal sigma of each component's amplitude
    subject_position: float = 0.10  # head radii
    subject_direction: float = 0.30  # of the unit vector, along each axis
    background: float = 7.0  # uV, RMS of the 1/f activity, mean over EEG channels
    exponent: float = 1.2  # its power falls as 1/f^exponent
    background_spread: float = 0.8  # log-normal sigma of the generators' power between subjects
    alpha: float = 4.0  # uV RMS at the occipital electrodes
    noise: float = 0.5  # uV RMS, amplifier and electrode, each electrode on its own
    blinks: float = 0.15  # per second
    human_error: float = 0.015  # share of trials in which the subject pressed the wrong key
    resolution: float = 0.05  # uV, of the amplifier
    people: dict = field(default_factory=lambda: dict(_PEOPLE))
    seed: int = 20250713


MODEL = Model()


def recording(subject, model=MODEL):
    """Path of a subject's `.set` file in the cache, simulated first if it is not there.

    Parameters
    ----------
    subject : str
        ``s02`` to ``s13``.
    model : Model

    Returns
    -------
    Path
        ``<cache>/simulated-<hash of the parameters>/<subject>_cursor.set``, its `.fdt` beside it.

    Raises
    ------
    OSError
        If the cache cannot be written to.
    """
    key = sha256(canonical_json([_VERSION, asdict(model)]))[:12]
    path = dataset.cache_dir() / f"simulated-{key}" / f"{subject}_cursor.set"
    if not path.is_file() or not path.with_suffix(".fdt").is_file():
        write_set(path, *simulate(subject, model))
    return path


def simulate(subject, model=MODEL):
    """Simulate the recording of a subject.

    Parameters
    ----------
    subject : str
        ``s02`` to ``s13``.
    model : Model

    Returns
    -------
    data : ndarray of float32, shape (30, n_samples)
        Microvolts at 256 Hz against the mean of TP9 and TP10, channels in the order of
        `dataset.CHANNELS`.
    events : list of (float, str)
        1-based, fractional latency in samples, and name.
    """
    number = SUBJECTS.index(dataset.check_subject(subject, SUBJECTS, "the simulated recordings"))
    # One stream for each part, so that a parameter of one leaves the others as they were.
    person, course, noise, eyes = np.random.default_rng([model.seed, number]).spawn(4)
    trials, events, duration = _protocol(course, model)
    n_samples = int(duration * SFREQ)
    data = _background(n_samples, noise, person, model)
    _add_responses(data, trials, subject, person, course, model)
    _add_eyes(data, trials, eyes, model)
    _add_movements(data, eyes)
    # Rounding to the amplifier's resolution also makes the file the same on every machine: what
    # processors disagree on is far below it.
    data = np.round(data / model.resolution) * model.resolution
    return data.astype(np.float32), events


def write_set(path, data, events):
    """Write a recording as an EEGLAB `.set` with its data in a `.fdt` beside it.

    Parameters
    ----------
    path : Path
        Ends in `.set`.
    data : ndarray, shape (30, n_samples)
        Microvolts.
    events : list of (float, str)
        1-based latency in samples, and name.
    """
    n_channels, n_samples = data.shape
    with atomic_path(path.with_suffix(".fdt")) as temporary:
        np.asarray(data, "<f4").T.tofile(temporary)
    labels = np.zeros(n_channels, dtype=[("labels", object)])
    labels["labels"] = CHANNELS
    event = np.zeros(len(events), dtype=[("latency", object), ("type", object)])
    event["latency"] = [float(latency) for latency, _ in events]
    event["type"] = [name for _, name in events]
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
        "chanlocs": labels,
        "event": event,
        "comments": "Simulated by rlihf_lib; not a recording of a person.",
    }
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"EEG": eeg}, format="5", do_compression=True, oned_as="row")
    content = bytearray(buffer.getvalue())
    # scipy writes the time into the header, which would make every file different.
    content[:116] = b"MATLAB 5.0 MAT-file, rlihf_lib simulated recording".ljust(116)
    # The .set comes last: where it is, the .fdt is complete.
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _protocol(rng, model):
    """Trials (feedback time in s, error, block probability, direction), events, duration."""
    chances = rng.permutation(np.repeat([0.2, 0.5], dataset.N_BLOCKS // 2))
    trials, events, start = [], [], 5.0
    for chance in chances:
        for _ in range(dataset.N_TRIALS_PER_BLOCK):
            target = rng.integers(3)
            pressed = target
            stimulus = start + rng.uniform(0.3, 0.5)
            key = stimulus + min(0.25 + rng.lognormal(np.log(0.25), 0.35), 1.2)
            feedback = key + rng.uniform(0.015, 0.035)
            moved, outcome = target, dataset.CORRECT
            if rng.random() < model.human_error:
                pressed = moved = (target + rng.integers(1, 3)) % 3
                outcome = dataset.HUMAN_ERROR
            elif rng.random() < chance:
                moved, outcome = (target + rng.integers(1, 3)) % 3, dataset.MACHINE_ERROR
            end = feedback + rng.uniform(1.75, 1.85)
            # The amplifier sampled at 1000 Hz; the files' latencies are fractions of 1/256 s.
            feedback = round(feedback, 3)
            times = [
                (stimulus, dataset.STIMULI[target]),
                (key, dataset.RESPONSES[pressed]),
                (feedback, dataset.FEEDBACKS[moved]),
                (feedback + 0.001, outcome),
                (feedback + 1.0, dataset.FRAME),
                (feedback + 1.4, dataset.BACK),
                (end, dataset.TRIAL_END),
            ]
            events += [(round(time, 3) * SFREQ + 1, name) for time, name in times]
            trials.append((feedback, outcome == dataset.MACHINE_ERROR, chance, moved))
            start = end + rng.uniform(0.1, 0.2)
        start += 8.0
    return trials, events, start


@lru_cache
def _cortex():
    """Lead field of 162 dipoles all over the head but its base, all orientations.

    They lie deeper than the cortex because each stands for an extended patch of it, whose field is
    that of a deeper dipole: smooth, and so shared by neighbouring electrodes.
    """
    n = 216
    height = 1 - 2 * (np.arange(n) + 0.5) / n
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    across = np.sqrt(1 - height**2)
    shell = 0.40 * np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    return lead_field(shell[height > -0.5])


def _coloured(shape, power, rng):
    """Gaussian noise of RMS 1 whose power at f Hz is proportional to `power(f)`."""
    length = scipy.fft.next_fast_len(shape[-1], real=True)
    spectrum = np.sqrt(power(scipy.fft.rfftfreq(length, 1 / SFREQ)))
    spectrum[0] = 0.0
    # White noise of variance 1 has E|rfft|^2 = length at every frequency.
    spectrum *= np.sqrt(length / (2 * (spectrum**2).sum()))
    white = scipy.fft.rfft(rng.standard_normal((*shape[:-1], length)), axis=-1)
    return scipy.fft.irfft(white * spectrum, n=length, axis=-1)[..., : shape[-1]]


def _root(covariance):
    """Matrix A with A A' = covariance. Cholesky, for its answer is unique."""
    return np.linalg.cholesky(covariance + 1e-9 * np.trace(covariance) * np.eye(len(covariance)))


def _background(n_samples, rng, person, model):
    eeg = [name not in dataset.EOG_CHANNELS for name in CHANNELS]
    gain = _cortex()
    gain = gain * np.exp(model.background_spread * person.standard_normal(gain.shape[1]))[:, None]
    gain = gain.reshape(len(CHANNELS), -1)
    covariance = gain @ gain.T
    covariance *= model.background**2 / np.diag(covariance)[eeg].mean()
    data = _root(covariance) @ _coloured(
        (len(CHANNELS), n_samples), lambda f: (f + 0.5) ** -model.exponent, rng
    )
    peak = 10.0 + person.standard_normal()
    places = lead_field([[-0.25, -0.65, 0.15], [0.25, -0.65, 0.15], [0.0, -0.55, 0.40]])
    waves = np.einsum("csd,sd->cs", places, [[-0.3, -1, 0.2], [0.3, -1, 0.2], [0, -1, 0.5]])
    waves *= model.alpha * np.exp(0.4 * person.standard_normal()) / np.abs(waves[[14, 16]]).sum()
    data += (waves * 2) @ _coloured(
        (3, n_samples), lambda f: np.exp(-((f - peak) ** 2) / 2 / 0.9**2), rng
    )
    # Noise at the two mastoids enters every channel through the reference.
    noise = np.eye(len(CHANNELS)) + 0.5
    return data + model.noise * (_root(noise) @ rng.standard_normal(data.shape))


def _person(components, oddness, person, model):
    """Topography (channel, component) in uV and latencies in s of one subject's components."""
    n = len(components)
    position = np.array([c.position for c in components])
    position = position + oddness * model.subject_position * person.standard_normal((n, 3))
    position *= np.minimum(1.0, 0.8 / np.linalg.norm(position, axis=1))[:, None]
    direction = np.array([c.direction for c in components], dtype=float)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction = direction + oddness * model.subject_direction * person.standard_normal((n, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    moment = np.array([c.moment for c in components])
    moment = moment * np.exp(oddness * model.subject_spread * person.standard_normal(n))
    latency = np.array([c.latency for c in components])
    latency = latency + oddness * model.subject_latency * person.standard_normal(n)
    topography = np.einsum("csd,sd,s->cs", lead_field(position), direction, moment)
    return topography, latency, np.array([c.width for c in components])


def _add_responses(data, trials, subject, person, rng, model):
    """Add each trial's response to feedback and, on errors, the error response."""
    gain, shift, oddness = model.people[subject]
    always = _person(model.feedback, oddness, person, model)
    on_error = _person(model.error, oddness, person, model)
    for onset, error, chance, _ in trials:
        delay, spread, attention = rng.standard_normal(), rng.standard_normal(), rng.random()
        first = int(np.ceil(onset * SFREQ))
        time = np.arange(first, first + int(1.2 * SFREQ)) / SFREQ - onset
        # The frame a second later is seen too: the same visual response, 1 s on.
        for start in (0.0, 1.0):
            topography, latency, width = always
            begin = first + int(start * SFREQ)
            data[:, begin : begin + len(time)] += topography @ _bumps(time, latency + shift, width)
        if error and attention > model.lapse:
            size = gain * np.exp(model.trial_spread * spread - model.trial_spread**2 / 2)
            size *= model.frequent if chance > 0.3 else 1.0
            topography, latency, width = on_error
            late = latency + shift + model.jitter * delay
            data[:, first : first + len(time)] += size * topography @ _bumps(time, late, width)


def _bumps(time, latency, width):
    return np.exp(-0.5 * ((time - latency[:, None]) / width[:, None]) ** 2)


def _add_eyes(data, trials, rng, model):
    """Blinks at random moments; small saccades to where the feedback moved, and back."""
    eyes = lead_field([[-0.33, 0.72, -0.30], [0.33, 0.72, -0.30]]).sum(axis=1)
    fp1 = CHANNELS.index("Fp1")
    down = eyes[:, 2] * 0.4 + eyes[:, 1]
    down = down / down[fp1]
    n_samples = data.shape[1]
    time = np.arange(int(0.5 * SFREQ)) / SFREQ
    for start in np.flatnonzero(rng.random(n_samples) < model.blinks / SFREQ):
        shape = rng.uniform(70, 130) * np.exp(-0.5 * ((time - 0.18) / rng.uniform(0.05, 0.08)) ** 2)
        shape = shape[: n_samples - start]
        data[:, start : start + len(shape)] += down[:, None] * shape
    across = eyes[:, 0] / eyes[CHANNELS.index("EOG2"), 0]
    up = eyes[:, 2] / np.abs(eyes[CHANNELS.index("EOG3"), 2])
    looks = np.stack([-across, up, across], axis=1)
    time = np.arange(int(1.6 * SFREQ)) / SFREQ
    for onset, _, _, moved in trials:
        late, back = rng.normal(0.25, 0.04), rng.normal(1.3, 0.1)
        size = rng.uniform(3, 12)
        gaze = 1 / (1 + np.exp(-(time - late) / 0.008)) - 1 / (1 + np.exp(-(time - back) / 0.008))
        first = int(onset * SFREQ)
        data[:, first : first + len(time)] += size * looks[:, [moved]] * gaze


def _add_movements(data, rng):
    """A dozen bursts of half a second, as when the head moves and the cap slips."""
    time = np.arange(int(0.6 * SFREQ)) / SFREQ
    for start in rng.integers(0, data.shape[1] - len(time), 12):
        wave = np.sin(2 * np.pi * rng.uniform(2, 5) * time) * np.hanning(len(time))
        data[:, start : start + len(time)] += rng.normal(0, 120, len(data))[:, None] * wave
