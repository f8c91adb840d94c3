"""The epochs a decoder sees: channels by name, one window, about 32 Hz, one scale."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from rlihf_lib.files import canonical_json, sha256

NETWORK_RATE = 30.0  # Hz, at least; error potentials lie below 10 Hz
STEP = 0.05  # s, of the means that linear decoders see
UNIT = 10e-6  # V; brings EEG near 1, the batch normalisations do the rest
CLASSES = ("correct", "error")
#: Relative; processors differ by 2e-5, one other epoch in 500 by more than it.
POWER_TOLERANCE = 1e-3


@dataclass(frozen=True)
class SubjectEpochs:
    """Epochs of one subject as arrays; a ValueError names what cannot be decoded, and a remedy."""

    subject: str
    signals: np.ndarray  # volts, shape (n, n_channels, n_times)
    labels: np.ndarray  # shape (n,), 1 = error, 0 = correct
    index: np.ndarray  # shape (n,), number of the feedback event within the recording
    channels: tuple
    sfreq: float  # Hz
    tmin: float  # time of the first sample relative to the feedback, s

    def __post_init__(self):
        n = len(self.signals)
        if len(np.unique(self.index)) != n:
            raise ValueError(f"subject {self.subject}: {n} epochs need as many distinct indices")
        finite = np.isfinite(self.signals).all(axis=2)
        if not finite.all():
            epoch, channel = np.argwhere(~finite)[0]
            raise ValueError(
                f"subject {self.subject}: NaN or infinity in epoch {self.index[epoch]}, channel "
                f"{self.channels[channel]}; drop or repair the epoch before decoding"
            )
        counts = {name: int(np.sum(self.labels == i)) for i, name in enumerate(CLASSES)}
        if min(counts.values()) == 0:
            raise ValueError(
                f"subject {self.subject}: epochs by class {counts}; both classes are needed, "
                "labelled 0 (correct) and 1 (error)"
            )

    @classmethod
    def from_mne(cls, subject, epochs, channels="eeg") -> "SubjectEpochs":
        """Take the channels of type "eeg", "eog", or both ("all") of preprocessed MNE epochs."""
        types = ["eeg", "eog"] if channels == "all" else [channels]
        if not set(types) & set(epochs.get_channel_types()):
            raise ValueError(
                f"subject {subject}: no channel of type {channels!r}; there are "
                f"{', '.join(sorted(set(epochs.get_channel_types())))}"
            )
        picked = epochs.copy().pick(types)
        return cls(
            subject=subject,
            signals=picked.get_data(copy=False),
            labels=(epochs.events[:, 2] == epochs.event_id.get("error")).astype(np.int64),
            index=epochs.metadata["epoch"].to_numpy(),
            channels=tuple(picked.ch_names),
            sfreq=float(epochs.info["sfreq"]),
            tmin=float(epochs.tmin),
        )

    def fingerprint(self) -> str:
        """Hash labels and layout: what is the same to the last bit on every computer."""
        layout = [self.subject, self.channels, self.sfreq, self.tmin]
        return sha256(canonical_json([layout, self.labels.tolist(), self.index.tolist()]))

    def power(self) -> list[list[float]]:
        """Mean power of each class (2) in each channel, in µV², to six digits.

        By it shipped results recognise signals (`same_power`), for no hash can: filters and
        simulation differ a little between processors.
        """
        by_class = [self.signals[self.labels == i] for i in range(len(CLASSES))]
        means = [np.square(1e6 * part, dtype=np.float64).mean((0, 2)) for part in by_class]
        return [[float(f"{value:.5e}") for value in mean] for mean in means]


def averaged(signals, width) -> np.ndarray:
    """Means of every `width` samples, as far as they are whole: (..., n_times // width)."""
    whole = signals[..., : signals.shape[-1] // width * width]
    return whole.reshape(*whole.shape[:-1], -1, width).mean(axis=-1)


def covariances(signals) -> np.ndarray:
    """Spatial covariance of each epoch, shape (n, n_channels, n_channels)."""
    centred = signals - signals.mean(axis=2, keepdims=True)
    return centred @ centred.transpose(0, 2, 1) / (signals.shape[2] - 1)


def inverse_root(covariance) -> np.ndarray:
    """Symmetric inverse square root of a covariance matrix."""
    power, axes = eigh(covariance)
    # An average reference leaves one direction without power, which must not be blown up.
    return (axes / np.sqrt(power + 1e-3 * power.mean())) @ axes.T


def same_power(first, second) -> bool:
    """Whether two results of `SubjectEpochs.power` are of the same signals."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    return first.shape == second.shape and np.allclose(first, second, POWER_TOLERANCE, 0)


@dataclass(frozen=True)
class InputFormat:
    """How epochs become what the networks see; the same for every subject of a study."""

    channels: tuple  # looked up by name, so their order in a recording does not matter
    sfreq: float  # of the epochs, Hz; what follows is of the epochs, too
    tmin: float  # s after the feedback
    n_times: int
    start: int  # the samples that are decoded
    stop: int
    #: Samples averaged into one, down to 30 to 60 Hz. Error potentials lie below 10 Hz, so that
    #: nothing of them is lost, some noise is, and the networks have an eighth of the work.
    decimation: int

    @classmethod
    def of(cls, epochs: SubjectEpochs, window) -> "InputFormat":
        """Read the format off a subject's epochs.

        `window`, two times in s after the feedback, is cut to what the epochs hold; a ValueError
        says if that is nothing.
        """
        n_times = epochs.signals.shape[-1]
        start, stop = (round((t - epochs.tmin) * epochs.sfreq) for t in window)
        start, stop = max(start, 0), min(stop, n_times)
        decimation = max(1, int(epochs.sfreq / NETWORK_RATE))
        stop = start + (stop - start) // decimation * decimation
        if stop <= start:
            end = epochs.tmin + n_times / epochs.sfreq
            raise ValueError(
                f"subject {epochs.subject}: epochs from {epochs.tmin:g} to {end:g} s hold nothing "
                f"of the window {window[0]:g} to {window[1]:g} s; choose another window"
            )
        return cls(epochs.channels, epochs.sfreq, epochs.tmin, n_times, start, stop, decimation)

    @property
    def network_sfreq(self) -> float:
        """Sampling rate the networks see, Hz."""
        return self.sfreq / self.decimation

    @property
    def offset(self) -> int:
        """Samples from the feedback to the first one that is decoded."""
        return round(self.tmin * self.sfreq) + self.start

    def pick(self, epochs: SubjectEpochs) -> np.ndarray:
        """A subject's signals, shape (n, n_channels, n_times), channels in order by name.

        A ValueError says if a channel is missing, or sampling rate or epoch length differ.
        """
        if missing := [name for name in self.channels if name not in epochs.channels]:
            raise ValueError(
                f"subject {epochs.subject} lacks the channel(s) {', '.join(missing)}; decode the "
                "channels all subjects have, or interpolate them first"
            )
        shape = (epochs.sfreq, epochs.tmin, epochs.signals.shape[-1])
        if not np.allclose(shape, (self.sfreq, self.tmin, self.n_times)):
            raise ValueError(
                f"subject {epochs.subject}: epochs at {shape[0]:g} Hz from {shape[1]:g} s with "
                f"{shape[2]} samples, others at {self.sfreq:g} Hz from {self.tmin:g} s with "
                f"{self.n_times}; cut and resample all subjects alike"
            )
        return epochs.signals[:, [epochs.channels.index(name) for name in self.channels]]

    def window(self, signals) -> np.ndarray:
        """The samples that are decoded, (..., stop - start), of epochs, or of what is cut so."""
        cut = signals.shape[-1] == self.stop - self.start
        return signals if cut else signals[..., self.start : self.stop]

    def condition(self, signals) -> np.ndarray:
        """Cut the window, average neighbouring samples, in units of 10 µV: (n, n_channels, m).

        Each epoch by itself: nothing is normalised over epochs or subjects. (On real feedback
        potentials, per-subject scaling and Euclidean alignment lost AUROC on validation subjects.)
        """
        return self._cut(signals, self.decimation)

    def means(self, signals) -> np.ndarray:
        """Cut the window, average over 50 ms each, in units of 10 µV: (n, n_channels, k)."""
        return self._cut(signals, round(STEP * self.sfreq))

    def _cut(self, signals, width):
        return averaged(self.window(signals).astype(np.float64), width) / UNIT
