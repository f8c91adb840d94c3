"""A trained decoder: epochs in volts in, p(error) out; saved without pickles."""

import json
from dataclasses import asdict

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from scipy.ndimage import correlate1d

from rlihf_lib.eeg.eegnet import Architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.scores import probability
from rlihf_lib.eeg.signals import InputFormat
from rlihf_lib.files import atomic_path


class Decoder:
    """EEGNets with one temperature; `prior` is the fraction of errors in their training pool.

    Where there is a `linear` decoder beside them, weights (n_channels, k) of `InputFormat.means`
    and a `bias`, its log-odds are added to theirs (`stacking`). A decoder for live use knows the
    `band`, Hz, of the causal filter (`streaming.CausalFilter`) that its training epochs went
    through; None if they were filtered forward and backward.
    """

    def __init__(
        self, input_format: InputFormat, networks: EEGNetBatch, temperature=1.0, prior=0.5,
        linear: np.ndarray | None = None, bias=0.0, band: tuple[float, float] | None = None,
    ):  # fmt: skip
        self.input_format = input_format
        self.linear, self.bias, self.band = linear, bias, band
        # Double precision costs nothing at this size, and makes p the same in any batch and chunk.
        self.networks = networks.double().eval()
        self.temperature = temperature
        self.prior = prior

    def inputs(self, signals) -> torch.Tensor:
        """What the networks see of epochs (as for `log_odds`), each of them the same."""
        x = torch.from_numpy(self.input_format.condition(signals)).transpose(0, 1)[:, None]
        return x.expand(-1, self.networks.n_networks, -1, -1).contiguous()

    @torch.no_grad()
    def log_odds(self, signals) -> np.ndarray:
        """Logit of error minus logit of correct, the mean over the networks, shape (n,).

        Of preprocessed epochs in volts, shape (n, n_channels, n_times), channels as in
        `input_format`, or of no more of them than its window. A ValueError says if the shape does
        not fit or a value is not finite.
        """
        layout = self.input_format
        n_channels, lengths = len(layout.channels), (layout.n_times, layout.stop - layout.start)
        if signals.ndim != 3 or signals.shape[1] != n_channels or signals.shape[2] not in lengths:
            raise ValueError(
                f"epochs of shape {signals.shape}; this decoder takes (n, {n_channels} channels, "
                f"{lengths[0]} samples at {layout.sfreq:g} Hz, or the {lengths[1]} it decodes)"
            )
        if not np.isfinite(signals).all():
            raise ValueError("NaN or infinity in the EEG; drop the epoch or repair the channel")
        logits = self.networks(self.inputs(signals))
        log_odds = (logits[..., 1] - logits[..., 0]).mean(0).numpy()
        if self.linear is not None:
            log_odds += (layout.means(signals) * self.linear).sum((1, 2)) + self.bias
        return log_odds

    def p_error(self, signals) -> np.ndarray:
        """Calibrated p(error), Eq. (3), shape (n,), of epochs as for `log_odds`."""
        return probability(self.log_odds(signals), self.temperature, self.prior)

    def patterns(self, signals, network=0) -> tuple[np.ndarray, np.ndarray]:
        """What the filters of one network follow in epochs as for `log_odds`.

        Temporal filters, shape (F1, kernel), at `input_format.network_sfreq`; patterns, shape
        (F1, D, n_channels): Cov(x) w / Var(w x), x the signals behind the temporal filter, the
        activity that a spatial filter w follows. Its weights themselves also serve to cancel
        noise, and say nothing of places (Haufe et al. 2014, NeuroImage 87, 96-110).
        """
        state = self.networks.network_state(network)
        temporal = state["temporal.weight"].detach().numpy()[:, 0, 0]
        weights = state["spatial.weight"].detach().numpy()
        weights = weights.reshape(len(temporal), -1, signals.shape[1])
        conditioned = self.input_format.condition(signals)
        patterns = []
        for kernel, filters in zip(temporal, weights, strict=True):
            x = correlate1d(conditioned, kernel, axis=-1, mode="constant")
            followed = filters @ np.cov(x.swapaxes(0, 1).reshape(x.shape[1], -1))
            patterns.append(followed / (followed * filters).sum(axis=1, keepdims=True))
        return temporal, np.array(patterns)

    def save(self, path) -> None:
        """Write weights and everything needed to use them to a safetensors file, atomically."""
        header = {
            "input_format": asdict(self.input_format),
            "architecture": asdict(self.networks.architecture),
            "temperature": self.temperature,
            "prior": self.prior,
        }
        # Trained in single precision, so nothing is lost.
        tensors = {n: value.float().contiguous() for n, value in self.networks.state_dict().items()}
        if self.linear is not None:
            header["bias"] = self.bias
            tensors["linear"] = torch.from_numpy(self.linear)
        if self.band is not None:
            header["band"] = self.band
        with atomic_path(path) as temporary:
            # One entry, because safetensors writes several in random order.
            temporary.write_bytes(save(tensors, metadata={"decoder": json.dumps(header)}))

    @classmethod
    def load(cls, path) -> "Decoder":
        """Read a decoder; a ValueError says if the file is damaged or not one of ours."""
        try:
            with safe_open(path, framework="pt") as file:
                header = json.loads(file.metadata()["decoder"])
                tensors = {name: file.get_tensor(name) for name in file.keys()}
            layout = header["input_format"]
            input_format = InputFormat(**layout | {"channels": tuple(layout["channels"])})
            architecture = Architecture(**header["architecture"])
            linear = tensors.pop("linear").numpy() if "bias" in header else None
            networks = EEGNetBatch(architecture, range(len(tensors["dense_bias"])))
            networks.load_state_dict(tensors)
            told = header["temperature"], header["prior"], linear, header.get("bias", 0.0)
            band = header.get("band")
            return cls(input_format, networks, *told, band and tuple(band))
        except (SafetensorError, KeyError, TypeError, RuntimeError) as error:
            raise ValueError(
                f"{path} is not a decoder of this library or is damaged ({error}); train it anew "
                "with notebook 02 and --recompute"
            ) from error
