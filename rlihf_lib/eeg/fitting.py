"""Training the networks of one fold, Eq. (2), on what its training pool hands out."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from scipy.special import logit
from torch.nn import functional as F
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.eegnet import half_second_architecture
from rlihf_lib.eeg.ensemble import EEGNetBatch
from rlihf_lib.eeg.scores import fit_temperature
from rlihf_lib.eeg.stacking import stack
from rlihf_lib.files import sha256


@dataclass(frozen=True)
class DecoderSettings:
    """Everything that decides what a decoder learns, except the data."""

    max_epochs: int = 30  # passes over the training subjects at most; see `LEAST_UPDATES`
    patience: int = 8  # passes without a better validation loss after which a network stops
    #: Networks per fold, each with its own seed and validation subjects; log-odds are averaged.
    ensemble: int = 6
    n_permutations: int = 1000  # and bootstrap resamples, behind chance levels and intervals
    n_validation: int = 1  # subjects of each network; the networks of a fold have different ones
    #: Seconds after the feedback that are decoded, as far as the epochs reach. All components of
    #: the error potential lie within.
    window: tuple = (0.0, 1.0)
    channels: str = "eeg"  # or to check what eye movements contribute "eog" or "all"
    batch_size: int = 64
    learning_rate: float = 3e-3  # of Adam; falls to zero along a cosine over `max_epochs` passes
    weight_decay: float = 0.0
    averaging: float = 0.98  # weight of the past in the running mean of weights, which is used
    dropout: float = 0.25  # published value for decoding across subjects
    seed: int = 0
    linear: bool = False  # whether two linear decoders stand beside the networks (`stacking`)


DEFAULTS = DecoderSettings()
#: Of the weights, in what counts as one pass: of few epochs several passes, so that training is as
#: long in updates as it has to be. Networks need some hundred of them to learn anything, and the
#: running mean of weights, which has no other warm-up, some dozens to forget the start. On planted
#: error potentials (3 people of 100 epochs, 15 passes) AUROC was .86 with 1, .96 with 6, 10 and 20;
#: LDA's is .96.
LEAST_UPDATES = 10


@dataclass(frozen=True)
class FoldData:
    """The epochs of a training pool, joined, and which of them train and validate each network."""

    x: torch.Tensor  # epochs, shape (n_channels, n, n_times)
    labels: torch.Tensor  # shape (n,), 1 = error
    offsets: torch.Tensor  # shape (n,), prior log-odds of an error of each epoch's subject
    subjects: np.ndarray  # shape (n,)
    training: list[torch.Tensor]  # of every network, the rows that train it
    validation: list[torch.Tensor]  # of every network, the rows that decide when it stops


def fit_fold(pool, input_format, settings) -> tuple[Decoder, pd.DataFrame, pd.DataFrame]:
    """Train and calibrate the decoder of one fold, on a GPU if there is one.

    From a `splits.TrainingPool`, subject -> (epochs (n, n_channels, m), labels (n,), means (n,
    n_channels, k)), as the `signals.InputFormat` makes them, to the decoder and the tables of
    `_validate` and `train`.
    The held-out subject is not in the pool, so nothing here can depend on that subject.

    Notes
    -----
    All networks of the fold are trained as one (`ensemble.EEGNetBatch`), by Adam on the
    cross-entropy. How many errors a subject makes is added to the logits, as its prior log-odds
    (logit adjustment: Menon et al. 2021, ICLR, here per subject). What is left to learn is the
    evidence in the EEG, not who makes many errors. Each network keeps the weights of the pass with
    the lowest loss on its validation subjects. One temperature is then fitted to the log-odds that
    the networks give these.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    members = range(len(pool.fold.validation))
    data = join(pool, members, device)
    seeds = [int(sha256(f"{settings.seed}/{pool.fold.test}/{n}")[:8], 16) for n in members]
    n_channels, _, n_times = data.x.shape
    rate, dropout = input_format.network_sfreq, settings.dropout
    architecture = half_second_architecture(n_channels, n_times, rate, dropout)
    networks = EEGNetBatch(architecture, seeds).to(device)
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        torch.manual_seed(seeds[0])  # dropout
        history = train(networks, data, seeds, settings)
    validation = _validate(networks.double().eval().cpu(), data)
    prior = float(data.labels.double().mean())
    if settings.linear:
        linear, bias, temperature = stack(validation, pool)
    else:
        evidence = validation[["log_odds", "label", "prior_log_odds"]].to_numpy().T
        linear, bias, temperature = None, 0.0, fit_temperature(*evidence)
    decoder = Decoder(input_format, networks, temperature, prior, linear, bias)
    return decoder, validation, history


def join(pool, members, device="cpu") -> FoldData:
    """Join the epochs of a `splits.TrainingPool` for some networks of its fold, by number."""
    fold = pool.fold
    signals, labels, *_ = zip(*pool.values(), strict=True)
    subjects = np.repeat(list(pool), [len(part) for part in labels])
    offsets = [np.full(len(part), logit(part.mean()), np.float32) for part in labels]
    x = np.ascontiguousarray(np.concatenate(signals).transpose(1, 0, 2), dtype=np.float32)

    def tensor(array):
        return torch.from_numpy(array).to(device)

    def rows(people):
        return tensor(np.concatenate([np.flatnonzero(subjects == subject) for subject in people]))

    return FoldData(
        x=tensor(x),
        labels=tensor(np.concatenate(labels)),
        offsets=tensor(np.concatenate(offsets)),
        subjects=subjects,
        training=[rows(fold.training(member)) for member in members],
        validation=[rows(fold.validation[member]) for member in members],
    )


def train(networks, data, seeds, settings) -> pd.DataFrame:
    """Train networks, an `EEGNetBatch`, in place and leave each with its best weights.

    `seeds` are those of every network's order of epochs. The table has a row per network and pass.
    """
    rate, decay = settings.learning_rate, settings.weight_decay
    optimizer = torch.optim.Adam(networks.parameters(), rate, weight_decay=decay, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.max_epochs)
    running_mean = get_ema_multi_avg_fn(settings.averaging)
    averaged = AveragedModel(networks, multi_avg_fn=running_mean, use_buffers=True)
    average: Any = averaged.module
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    with torch.no_grad():
        means, seconds = networks.patch_moments(data.x.transpose(0, 1).contiguous())
    repeats = passes_at_a_time(min(map(len, data.training)), settings.batch_size)
    best: list = [(np.inf, 0, {})] * len(seeds)  # validation loss, pass, weights
    history = []
    for number in range(settings.max_epochs):
        networks.train()
        batches = torch.cat(
            [_batches(data.training, generators, settings.batch_size) for _ in range(repeats)]
        )
        training_loss = torch.zeros(len(seeds), device=data.x.device)
        for rows in batches:
            moments = means[rows].mean(1), seconds[rows].mean(1)
            loss = _losses(networks(data.x[:, rows], moments), data, rows).mean(1)
            optimizer.zero_grad()
            loss.sum().backward()
            optimizer.step()
            networks.constrain()
            averaged.update_parameters(networks)
            training_loss += loss.detach() / len(batches)
        for network, loss in enumerate(_validation_losses(average, data)):
            history.append((network, number, float(training_loss[network]), loss))
            if loss < best[network][0]:
                state = average.network_state(network)
                best[network] = loss, number, {n: v.detach().clone() for n, v in state.items()}
        if number - max(when for _, when, _ in best) >= settings.patience:
            break
        schedule.step()
    networks.load_network_states([state for _, _, state in best])
    return pd.DataFrame(history, columns=["network", "pass", "training_loss", "validation_loss"])


def passes_at_a_time(n_epochs, batch_size) -> int:
    """How many passes over so many epochs count as one, that it may be `LEAST_UPDATES` long."""
    return -(-LEAST_UPDATES // max(1, n_epochs // batch_size))


def _batches(training, generators, size):
    """Rows of a pass in random order, shape (n_batches, n_networks, batch).

    As many batches for every network; the few epochs left over change from pass to pass.
    """
    shortest = min(len(rows) for rows in training)
    size = min(size, shortest)
    order = [
        rows[torch.randperm(len(rows), generator=generator)[: shortest // size * size]]
        for rows, generator in zip(training, generators, strict=True)
    ]
    return torch.stack(order).view(len(training), -1, size).transpose(0, 1)


def _losses(logits, data, rows):
    """Cross-entropy of every epoch, shape (n_networks, n), given its subject's prior log-odds."""
    log_odds = logits[..., 1] - logits[..., 0] + data.offsets[rows]
    return F.softplus(torch.where(data.labels[rows] == 1, -log_odds, log_odds))


@torch.no_grad()
def _validation_losses(networks, data):
    """Mean loss of every network on its own validation subjects."""
    networks.eval()
    rows = torch.nn.utils.rnn.pad_sequence(data.validation, batch_first=True)
    losses = _losses(networks(data.x[:, rows]), data, rows)
    return [float(loss[: len(r)].mean()) for loss, r in zip(losses, data.validation, strict=True)]


@torch.no_grad()
def _validate(networks, data):
    """Table of what every network gives its own validation subjects, in double precision."""
    scored = []
    for network, rows in enumerate(data.validation):
        x = data.x[:, rows].double().cpu()[:, None].expand(-1, networks.n_networks, -1, -1)
        logits = networks(x.contiguous())[network]
        columns = {
            "network": network,
            "subject": data.subjects[rows.cpu()],
            "label": data.labels[rows].cpu(),
            "log_odds": logits[:, 1] - logits[:, 0],
            "prior_log_odds": data.offsets[rows].cpu(),
        }
        scored.append(pd.DataFrame(columns))
    return pd.concat(scored, ignore_index=True)
