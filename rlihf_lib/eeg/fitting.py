"""Training the networks of one fold, Eq. (2), on what its training pool hands out."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from scipy.special import logit
from torch.nn import functional as F
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from rlihf_lib.eeg.calibration import fit_temperature
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import EEGNetBatch, half_second_architecture
from rlihf_lib.files import sha256


@dataclass(frozen=True)
class DecoderSettings:
    """Everything that decides what a decoder learns, except the data."""

    max_epochs: int = 30
    """Passes over the training subjects at most."""
    patience: int = 8
    """Passes without a better validation loss after which a network stops."""
    ensemble: int = 6
    """Networks per fold, each with its own seed and validation subjects; their log-odds are
    averaged."""
    n_permutations: int = 1000
    """Bootstrap resamples and label permutations behind intervals and chance levels."""
    n_validation: int = 1
    """Validation subjects of each network; the networks of a fold have different ones."""
    window: tuple = (0.0, 1.0)
    """Seconds after the feedback that are decoded, as far as the epochs reach. All components of
    the error potential lie within."""
    channels: str = "eeg"
    """Decoded channels: "eeg", or to check what eye movements contribute "eog" or "all"."""
    batch_size: int = 64
    learning_rate: float = 3e-3
    """Of Adam at the start; it falls to zero along a cosine over `max_epochs` passes."""
    weight_decay: float = 0.0
    averaging: float = 0.98
    """Weight of the past in the running mean of each network's weights, which is what is used."""
    dropout: float = 0.25
    """Published value for decoding across subjects."""
    seed: int = 0


DEFAULTS = DecoderSettings()


@dataclass(frozen=True)
class FittedFold:
    """What training a fold gives."""

    decoder: Decoder
    validation: pd.DataFrame
    """network, subject, label, log_odds: every network on its own validation subjects."""
    history: pd.DataFrame
    """network, pass, training_loss, validation_loss."""


def choose_device(device="auto"):
    """Return a torch device: the one named, or with "auto" a GPU if there is one."""
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(device)


def fit_fold(pool, input_format, settings, device="auto"):
    """Train and calibrate the decoder of one fold.

    Parameters
    ----------
    pool : splits.TrainingPool
        Subject -> (conditioned epochs (n, n_channels, m), labels (n,)). The held-out subject is
        not in it, so nothing here can depend on that subject.
    input_format : signals.InputFormat
        How the epochs were conditioned; the decoder conditions new ones in the same way.
    settings : DecoderSettings
    device : str

    Returns
    -------
    FittedFold

    Notes
    -----
    All networks of the fold are trained as one (`eegnet.EEGNetBatch`), by Adam on the
    cross-entropy. How many errors a subject makes is added to the logits, as its prior log-odds
    (logit adjustment: Menon et al. 2021, ICLR, here per subject). What is left to learn is the
    evidence in the EEG, not who makes many errors.
    Each network keeps the weights of the pass with the lowest loss on its validation subjects.
    One temperature is then fitted to the log-odds that the networks give their own validation
    subjects.
    """
    device = choose_device(device)
    fold = pool.fold
    x, y, offsets, rows = concatenate(pool, device)
    training, validation = (
        [torch.cat([rows[s] for s in subjects]) for subjects in per_network]
        for per_network in (
            [fold.training(network) for network in range(len(fold.validation))],
            fold.validation,
        )
    )
    seeds = [
        int(sha256(f"{settings.seed}/{fold.test}/{network}")[:8], 16)
        for network in range(len(fold.validation))
    ]
    architecture = half_second_architecture(
        x.shape[0], x.shape[2], input_format.network_sfreq, settings.dropout
    )
    networks = EEGNetBatch(architecture, seeds).to(device)
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        torch.manual_seed(seeds[0])  # dropout
        history = train(networks, x, y, offsets, training, validation, seeds, settings)
    networks = networks.double().eval().cpu()
    x, y, offsets = x.double().cpu(), y.cpu().numpy(), offsets.cpu().numpy()
    results = []
    for network, subjects in enumerate(fold.validation):
        for subject in subjects:
            epochs = x[:, rows[subject].cpu()][:, None].expand(-1, len(seeds), -1, -1)
            with torch.no_grad():
                logits = networks(epochs.contiguous())[network]
            results.append(
                pd.DataFrame(
                    {
                        "network": network,
                        "subject": subject,
                        "label": y[rows[subject].cpu()],
                        "log_odds": (logits[:, 1] - logits[:, 0]).numpy(),
                        "prior_log_odds": offsets[rows[subject].cpu()],
                    }
                )
            )
    scored = pd.concat(results, ignore_index=True)
    decoder = Decoder(
        input_format=input_format,
        networks=networks,
        temperature=fit_temperature(
            *(scored[name].to_numpy() for name in ("log_odds", "label", "prior_log_odds"))
        ),
        prior=float(y.mean()),
    )
    return FittedFold(decoder, scored, history)


def concatenate(pool, device):
    """Join the subjects: epochs (n_channels, n, m), labels and prior log-odds (n,), their rows."""
    rows, offsets, first = {}, [], 0
    for subject, (_, labels) in pool.items():
        rows[subject] = torch.arange(first, first + len(labels), device=device)
        offsets.append(np.full(len(labels), logit(labels.mean()), np.float32))
        first += len(labels)
    x = np.concatenate([signals for signals, _ in pool.values()]).transpose(1, 0, 2)
    y = np.concatenate([labels for _, labels in pool.values()])
    x = torch.from_numpy(np.ascontiguousarray(x, dtype=np.float32))
    offsets = torch.from_numpy(np.concatenate(offsets))
    return x.to(device), torch.from_numpy(y).to(device), offsets.to(device), rows


def train(networks, x, y, offsets, training, validation, seeds, settings):
    """Train networks in place and leave each with its best weights.

    Parameters
    ----------
    networks : eegnet.EEGNetBatch
    x : Tensor, shape (n_channels, n, m)
    y, offsets : Tensor, shape (n,)
        Labels, and the prior log-odds of each epoch's subject.
    training, validation : list of Tensor
        For every network the epochs it trains on, and those that decide when it stops.
    seeds : list of int
        Of every network's order of epochs.
    settings : DecoderSettings

    Returns
    -------
    DataFrame
        network, pass, training_loss, validation_loss.
    """
    optimizer = torch.optim.Adam(
        networks.parameters(),
        lr=settings.learning_rate,
        weight_decay=settings.weight_decay,
        fused=True,
    )
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    averaged = AveragedModel(
        networks, multi_avg_fn=get_ema_multi_avg_fn(settings.averaging), use_buffers=True
    )
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.max_epochs)
    with torch.no_grad():
        means, seconds = networks.patch_moments(x.transpose(0, 1).contiguous())
    shortest = min(len(rows) for rows in training)
    batch = min(settings.batch_size, shortest)
    best_loss = [np.inf] * len(seeds)
    best_pass = [0] * len(seeds)
    best_state = [None] * len(seeds)
    history = []
    for number in range(settings.max_epochs):
        networks.train()
        # As many batches for every network; the few epochs left over change from pass to pass.
        order = torch.stack(
            [
                rows[torch.randperm(len(rows), generator=g)[: shortest // batch * batch]]
                for rows, g in zip(training, generators, strict=True)
            ]
        ).view(len(seeds), -1, batch)
        training_loss = 0.0
        for step in range(order.shape[1]):
            rows = order[:, step]
            logits = networks(x[:, rows], (means[rows].mean(1), seconds[rows].mean(1)))
            loss = _losses(logits, y[rows], offsets[rows]).mean(1)
            optimizer.zero_grad()
            loss.sum().backward()
            optimizer.step()
            networks.constrain()
            averaged.update_parameters(networks)
            training_loss = training_loss + loss.detach() / order.shape[1]
        losses = _validation_losses(averaged.module, x, y, offsets, validation)
        for network, loss in enumerate(losses):
            history.append((network, number, float(training_loss[network]), loss))
            if loss < best_loss[network]:
                best_loss[network], best_pass[network] = loss, number
                best_state[network] = {
                    name: value.detach().clone()
                    for name, value in averaged.module.network_state(network).items()
                }
        if number - max(best_pass) >= settings.patience:
            break
        schedule.step()
    networks.load_network_states(best_state)
    return pd.DataFrame(history, columns=["network", "pass", "training_loss", "validation_loss"])


def _losses(logits, labels, offsets):
    """Cross-entropy of every epoch, shape (n_networks, n), given its subject's prior log-odds."""
    log_odds = logits[..., 1] - logits[..., 0] + offsets
    return F.softplus(torch.where(labels == 1, -log_odds, log_odds))


@torch.no_grad()
def _validation_losses(networks, x, y, offsets, validation):
    """Mean loss of every network on its own validation subjects."""
    networks.eval()
    longest = max(len(rows) for rows in validation)
    rows = torch.stack([F.pad(r[None], (0, longest - len(r)), "replicate")[0] for r in validation])
    losses = _losses(networks(x[:, rows]), y[rows], offsets[rows])
    return [float(loss[: len(r)].mean()) for loss, r in zip(losses, validation, strict=True)]
