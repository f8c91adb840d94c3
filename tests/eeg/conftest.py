"""Small recordings with a known answer."""

import mne
import numpy as np
import pandas as pd
import pytest

CHANNELS = ("Fz", "Cz", "Pz", "C3", "C4")


def planted_epochs(seed, amplitude=6e-6, n=60, channels=CHANNELS, sfreq=128.0, duration=0.8):
    """White noise of 5 µV; errors carry a Gaussian bump at 0.3 s on Cz, half of it on Fz."""
    rng = np.random.default_rng(seed)
    labels = np.arange(n) % 3 == 0
    data = rng.normal(0, 5e-6, (n, len(channels), int(duration * sfreq)))
    time = np.arange(data.shape[-1]) / sfreq
    bump = amplitude * np.exp(-(((time - 0.3) / 0.05) ** 2) / 2)
    for name, gain in (("Cz", 1.0), ("Fz", 0.5)):
        data[np.ix_(labels, [channels.index(name)])] += gain * bump
    info = mne.create_info(list(channels), sfreq, "eeg")
    events = np.column_stack([np.arange(n), np.zeros(n, int), labels + 1])
    metadata = pd.DataFrame({"epoch": np.arange(n), "label": labels.astype(int)})
    return mne.EpochsArray(
        data, info, events, event_id={"correct": 1, "error": 2}, metadata=metadata, verbose="error"
    )


@pytest.fixture(scope="session")
def make_epochs():
    return planted_epochs
