"""An amplifier to test with: it sends what it is given, at once, stamped as if in real time."""

import os

import numpy as np
import pytest

lsl = pytest.importorskip("mne_lsl.lsl", reason="mne-lsl is not installed (pip install '.[live]')")

#: Streams of this process only, found on the loopback address.
CONFIG = f"[lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = rlihf-{os.getpid()}\n[log]\nlevel = -3\n"
lsl.set_config_content(CONFIG)


class Amplifier:
    """A stream of EEG; `skip` and `send` move its clock on."""

    def __init__(self, name, channels, sfreq, unit="volts"):
        info = lsl.StreamInfo(name, "EEG", len(channels), sfreq, "float64", name)
        info.set_channel_names(list(channels))
        if unit:
            info.set_channel_units([unit] * len(channels))
        self._outlet = lsl.StreamOutlet(info)
        self.sfreq, self.n_sent, self._start = sfreq, 0, lsl.local_clock()

    def stamp(self, sample):
        """LSL time of a sample, counted from the first that could be sent."""
        return self._start + sample / self.sfreq

    def wait(self):
        """Wait until somebody listens: what nobody listens to is lost."""
        assert self._outlet.wait_for_consumers(60)

    def skip(self, n):
        """Lose samples."""
        self.n_sent += n

    def send(self, samples):
        """Send samples, shape (n_channels, n)."""
        stamps = self.stamp(self.n_sent + np.arange(samples.shape[1]))
        self._outlet.push_chunk(np.ascontiguousarray(samples.T), stamps)
        self.n_sent += samples.shape[1]
