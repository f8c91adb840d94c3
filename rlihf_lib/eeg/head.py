"""A simulated head: what its brain, its eyes and its movements put on the electrodes.

Dipoles lie in four concentric spheres (brain, cerebrospinal fluid, skull, scalp; MNE's default
conductivities) fitted to the ``standard_1020`` electrodes. Lengths are in head radii, from the
centre of the spheres: x to the right ear, y to the nose, z up. All potentials are microvolts
against the mean of TP9 and TP10, shape (30, n_samples), in the order of `hri.CHANNELS`.
"""

from dataclasses import astuple
from functools import lru_cache

import mne
import numpy as np
import scipy.fft
from scipy.special import expit

from rlihf_lib.eeg.hri import CHANNELS, EOG_CHANNELS, SFREQ

#: Electrode of the 10-20 system nearest to each EOG electrode: outer canthi and central forehead.
_EOG_PLACES = {"EOG1": "AF9", "EOG2": "AF10", "EOG3": "Fpz"}
_N_SHELL, _SHELL_RADIUS, _SHELL_BASE = 216, 0.40, -0.5  # dipoles, head radii, cosine from the top
_ALPHA_PLACES = ((-0.25, -0.65, 0.15), (0.25, -0.65, 0.15), (0.0, -0.55, 0.40))
_ALPHA_DIRECTIONS = ((-0.3, -1.0, 0.2), (0.3, -1.0, 0.2), (0.0, -1.0, 0.5))
_ALPHA_RATE, _ALPHA_WIDTH = 10.0, 0.9  # Hz, mean over people and SD of the peak
_EYES = ((-0.33, 0.72, -0.30), (0.33, 0.72, -0.30))
RESPONSE, BLINK, GAZE, MOVEMENT = 1.2, 0.5, 1.6, 0.6  # s, how long each lasts
BLINK_SIZE, SACCADE_SIZE = (70, 130), (3, 12)  # uV, from and to, at Fp1 and at the EOG electrodes
SACCADE = 0.008  # s, time constant
N_MOVEMENTS, MOVEMENT_SIZE = 12, 120  # a recording; uV, SD over electrodes


@lru_cache
def _model():
    """Electrodes (MNE Info), sphere model, its centre and head radius in m."""
    places = [_EOG_PLACES.get(name, name) for name in (*CHANNELS, "TP9", "TP10")]
    info = mne.create_info(places, SFREQ, "eeg")
    info.set_montage("standard_1020", verbose="error")
    sphere = mne.make_sphere_model("auto", "auto", info, verbose="error")
    return info, sphere, sphere["r0"], sphere.radius


def lead_field(positions) -> np.ndarray:
    """Potentials of unit dipoles at the electrodes, shape (30, n, 3): uV per nAm along x, y, z.

    Positions have shape (n, 3) and norms below 0.9, inside the brain's sphere.
    """
    info, sphere, centre, radius = _model()
    positions = centre + radius * np.atleast_2d(positions)
    dipoles = {"rr": positions, "nn": np.tile([0.0, 0.0, 1.0], (len(positions), 1))}
    source = mne.setup_volume_source_space(pos=dipoles, verbose="error")
    head = mne.transforms.Transform("head", "mri")
    forward = mne.make_forward_solution(
        info, head, source, sphere, meg=False, mindist=0.0, verbose="error"
    )
    # MNE gives V per Am, which is 1e-3 uV per nAm.
    gain = forward["sol"]["data"].reshape(len(info.ch_names), -1, 3) * 1e-3
    return gain[: len(CHANNELS)] - gain[len(CHANNELS) :].mean(axis=0)


@lru_cache
def _cortex():
    """Lead field of 162 dipoles all over the head but its base, all orientations.

    They lie deeper than the cortex because the field of an extended patch of it is that of a
    deeper dipole: smooth, and so shared by neighbouring electrodes.
    """
    height = 1 - 2 * (np.arange(_N_SHELL) + 0.5) / _N_SHELL
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(_N_SHELL)
    across = np.sqrt(1 - height**2)
    shell = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    return lead_field(_SHELL_RADIUS * shell[height > _SHELL_BASE])


def coloured(shape, power, rng) -> np.ndarray:
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


def background(n_samples, model, person, rng) -> np.ndarray:
    """1/f activity of the cortex, occipital alpha, and noise of amplifier and electrodes.

    Of the generators, `person` draws what stays the same in a person, `rng` what varies in time.
    """
    shape = len(CHANNELS), n_samples
    eeg = [name not in EOG_CHANNELS for name in CHANNELS]
    gain = _cortex()
    gain = gain * np.exp(model.background_spread * person.standard_normal(gain.shape[1]))[:, None]
    gain = gain.reshape(len(CHANNELS), -1)
    covariance = gain @ gain.T
    covariance *= model.background**2 / np.diag(covariance)[eeg].mean()
    data = _root(covariance) @ coloured(shape, lambda f: (f + 0.5) ** -model.exponent, rng)
    peak = _ALPHA_RATE + person.standard_normal()
    waves = np.einsum("csd,sd->cs", lead_field(_ALPHA_PLACES), _ALPHA_DIRECTIONS)
    occipital = [CHANNELS.index("O1"), CHANNELS.index("O2")]
    waves *= model.alpha * np.exp(0.4 * person.standard_normal()) / np.abs(waves[occipital]).sum()
    data += (waves * 2) @ coloured(
        (3, n_samples), lambda f: np.exp(-((f - peak) ** 2) / 2 / _ALPHA_WIDTH**2), rng
    )
    # Noise at the two mastoids enters every channel through the reference.
    noise = np.eye(len(CHANNELS)) + 0.5
    return data + model.noise * (_root(noise) @ rng.standard_normal(shape))


def _person(components, oddness, person, model):
    """Topography (channel, component) in uV, latencies and widths (s) of a person."""

    def normal(spread, like):
        return oddness * spread * person.standard_normal(like.shape)

    columns = zip(*map(astuple, components), strict=True)
    _, latency, width, position, direction, moment = map(np.array, columns)
    position = position + normal(model.subject_position, position)
    position *= np.minimum(1.0, 0.8 / np.linalg.norm(position, axis=1))[:, None]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    direction = direction + normal(model.subject_direction, direction)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    moment = moment * np.exp(normal(model.subject_spread, moment))
    latency = latency + normal(model.subject_latency, latency)
    return np.einsum("csd,sd,s->cs", lead_field(position), direction, moment), latency, width


def _bumps(time, latency, width):
    return np.exp(-0.5 * ((time - latency[:, None]) / width[:, None]) ** 2)


def add_responses(data, trials, subject, model, rngs) -> None:
    """Add each trial's response to feedback and, on errors, the error response."""
    person, rng = rngs  # for what is the person's, for what is the trial's
    gain, shift, oddness = model.people[subject]
    always = _person(model.feedback, oddness, person, model)
    on_error = _person(model.error, oddness, person, model)
    n_samples = int(RESPONSE * SFREQ)
    for trial in trials:
        delay, spread, attention = rng.standard_normal(), rng.standard_normal(), rng.random()
        first = int(np.ceil(trial.feedback * SFREQ))
        time = np.arange(first, first + n_samples) / SFREQ - trial.feedback
        topography, latency, width = always
        response = topography @ _bumps(time, latency + shift, width)
        # The frame a second later is seen too: the same visual response, 1 s on.
        for begin in (first, first + int(SFREQ)):
            data[:, begin : begin + n_samples] += response
        if trial.error and attention > model.lapse:
            size = gain * np.exp(model.trial_spread * spread - model.trial_spread**2 / 2)
            size *= model.frequent if trial.chance > 0.3 else 1.0  # 0.2 or 0.5
            topography, latency, width = on_error
            late = latency + shift + model.jitter * delay
            data[:, first : first + n_samples] += size * topography @ _bumps(time, late, width)


def add_eyes(data, trials, model, rng) -> None:
    """Add blinks at random moments; small saccades to where the feedback moved, and back."""
    eyes = lead_field(_EYES).sum(axis=1)
    down = eyes[:, 2] * 0.4 + eyes[:, 1]
    down = down / down[CHANNELS.index("Fp1")]
    n_samples = data.shape[1]
    time = np.arange(int(BLINK * SFREQ)) / SFREQ
    for start in np.flatnonzero(rng.random(n_samples) < model.blinks / SFREQ):
        size, width = rng.uniform(*BLINK_SIZE), rng.uniform(0.05, 0.08)
        shape = size * np.exp(-0.5 * ((time - 0.18) / width) ** 2)[: n_samples - start]
        data[:, start : start + len(shape)] += down[:, None] * shape
    across = eyes[:, 0] / eyes[CHANNELS.index("EOG2"), 0]
    up = eyes[:, 2] / np.abs(eyes[CHANNELS.index("EOG3"), 2])
    looks = np.stack([-across, up, across], axis=1)
    time = np.arange(int(GAZE * SFREQ)) / SFREQ
    for trial in trials:
        late, back = rng.normal(0.25, 0.04), rng.normal(1.3, 0.1)
        size = rng.uniform(*SACCADE_SIZE)
        gaze = expit((time - late) / SACCADE) - expit((time - back) / SACCADE)
        first = int(trial.feedback * SFREQ)
        data[:, first : first + len(time)] += size * looks[:, [trial.moved]] * gaze


def add_movements(data, rng) -> None:
    """Add bursts of half a second, as when the head moves and the cap slips."""
    time = np.arange(int(MOVEMENT * SFREQ)) / SFREQ
    for start in rng.integers(0, data.shape[1] - len(time), N_MOVEMENTS):
        wave = np.sin(2 * np.pi * rng.uniform(2, 5) * time) * np.hanning(len(time))
        sizes = rng.normal(0, MOVEMENT_SIZE, len(data))
        data[:, start : start + len(time)] += sizes[:, None] * wave
