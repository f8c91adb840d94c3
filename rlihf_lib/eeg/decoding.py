"""Leave-one-subject-out decoding: every subject's p(error) from a decoder that never saw them."""

import json
import os
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from rlihf_lib.eeg import scores
from rlihf_lib.eeg.calibration import probability
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.fitting import DEFAULTS, fit_fold
from rlihf_lib.eeg.leaks import channel_auroc, refuse_leaks
from rlihf_lib.eeg.preprocessing import Preprocessing, load_epochs
from rlihf_lib.eeg.signals import InputFormat, SubjectEpochs, same_power
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.eeg.streaming import replay
from rlihf_lib.files import canonical_json, sha256, write_csv, write_text

TABLES = ("scores", "p_error", "training")
_VERSION = 1  # raise when the method changes in anything but its settings


def run_loso(
    load, subjects, folder, settings=DEFAULTS, workers=0, recompute=False, device="auto",
    progress=None,
):  # fmt: skip
    """Train one decoder per held-out subject, replay that subject through it, and score.

    Parameters
    ----------
    load : callable or Mapping
        Subject -> preprocessed `mne.Epochs` with events "correct" and "error" and a metadata
        column `epoch`. A callable must be one that can be pickled (`loader` gives
        one), since worker processes call it.
    subjects : sequence of str
        At least three.
    folder : Path
        Receives scores.csv, p_error.csv, training.csv, config.json and
        weights/<subject>.safetensors. Finished folds lie in folds/<subject>/ and are skipped by
        the next call if settings and data are the same.
    settings : DecoderSettings
    workers : int
        Processes, one fold each at a time; 0 = as many as there are cores.
    recompute : bool
        Train folds that are finished, too.
    device : str
        "auto" (a GPU if there is one), "cpu", "cuda", ...
    progress : callable, optional
        Called as ``progress(finished, total, seconds)`` when a fold ends and once at the start,
        with seconds = None.

    Returns
    -------
    DataFrame
        One row per held-out subject: accuracy_pretrain (validation subjects, each decoded by the
        networks of this fold that did not train on it, p(error) > 0.5), accuracy_online (the
        held-out subject, replayed through the ring buffer, p(error) > 0.5), balanced_accuracy,
        auroc, ece, n_epochs, n_errors, and what `scores.score` adds.

    Raises
    ------
    ValueError
        If a subject cannot be decoded: channels, rates, NaN, classes; names subject and remedy.
        If a channel alone tells the classes apart (`leaks.refuse_leaks`).
    """
    subjects = list(subjects)
    folder = Path(folder)
    folds = leave_one_subject_out(subjects, settings.ensemble, settings.n_validation)
    data, identities, aurocs, input_format = {}, {}, [], None
    for subject in subjects:
        epochs = load_subject(load, subject, settings)
        input_format = input_format or InputFormat.of(epochs, settings.window)
        picked = input_format.pick(epochs)
        aurocs.append(channel_auroc(picked, epochs.labels))
        signals = input_format.condition(picked).astype(np.float32)
        data[subject] = signals, epochs.labels
        identities[subject] = epochs.fingerprint(), epochs.power()
    refuse_leaks(aurocs, input_format.channels, "the epochs")
    keys = {fold.test: _fold_key(fold, settings, input_format, identities) for fold in folds}
    missing = [f for f in folds if recompute or not _is_done(folder, f.test, keys[f.test])]
    if progress:
        progress(len(folds) - len(missing), len(folds), None)
    arguments = [
        (fold, fold.training_pool(data), input_format, load, settings, device, folder,
         keys[fold.test])
        for fold in missing
    ]  # fmt: skip
    # Starting a process costs about as much as a small fold.
    workers = min(workers or os.cpu_count(), -(-len(missing) // 3))
    finished = len(folds) - len(missing)
    for seconds in _run(arguments, workers):
        finished += 1
        if progress:
            progress(finished, len(folds), seconds)
    hashes = {subject: key["hash"] for subject, key in keys.items()}
    return _merge(folder, subjects, settings, input_format, hashes)


def loader(eeg, events=("correct", "error"), drop_channels=()):
    """Return the loader of a source's epochs that `run_loso` takes, in the recorded reference.

    Parameters
    ----------
    eeg : str or Path
        "simulated", "hri" or a folder of epochs; see `preprocessing.load_epochs`.
    events : pair of str
        Names of the correct and the error event in a folder of epochs.
    drop_channels : sequence of str
        Channels of a folder of epochs that are left out.

    Returns
    -------
    callable
        Subject -> `mne.Epochs`.

    Notes
    -----
    The spatial filters can learn the average reference, but once subtracted, what all electrodes
    share is lost: on validation subjects of the NER 2015 feedback potentials AUROC fell from 0.69
    to 0.64. The paper says "re-referencing"; its recordings come referenced to linked mastoids.
    """
    correct, error = events
    settings = Preprocessing(
        reference="recorded",
        correct_event=correct,
        error_event=error,
        drop_channels=tuple(drop_channels),
    )
    return partial(load_epochs, eeg, settings=settings)


def load_subject(load, subject, settings=DEFAULTS):
    """Load one subject's epochs as `signals.SubjectEpochs`."""
    epochs = load[subject] if isinstance(load, Mapping) else load(subject)
    return SubjectEpochs.from_mne(subject, epochs, settings.channels)


def load_decoder(folder, subject):
    """Load the decoder that never saw `subject`.

    Raises
    ------
    FileNotFoundError
        If its fold has not been trained yet.
    """
    path = Path(folder) / "weights" / f"{subject}.safetensors"
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist yet; run notebook 02_loso_decoder first")
    return Decoder.load(path)


def _run(arguments, workers):
    """Run folds here or in worker processes; give the seconds each took, as they finish."""
    if workers <= 1:
        yield from map(_run_fold, arguments)
        return
    # Spawned, because a forked process inherits the locks of PyTorch's and MNE's threads.
    with ProcessPoolExecutor(workers, get_context("spawn"), _one_thread) as executor:
        futures = [executor.submit(_run_fold, argument) for argument in arguments]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            executor.shutdown(cancel_futures=True)


def _one_thread():
    torch.set_num_threads(1)


def _run_fold(argument):
    """Train and score one fold and write its files, its key last; return the seconds."""
    fold, pool, input_format, load, settings, device, folder, key = argument
    start = time.perf_counter()
    fitted = fit_fold(pool, input_format, settings, device)
    decoder = fitted.decoder
    decoder.save(folder / "weights" / f"{fold.test}.safetensors")
    # Only now, with everything fitted, is the held-out subject looked at.
    held_out = load_subject(load, fold.test, settings)
    log_odds, latencies = replay(decoder, input_format.pick(held_out))
    table = pd.DataFrame(
        {
            "subject": fold.test,
            "epoch": held_out.index,
            "label": held_out.labels,
            "p_error": probability(log_odds, decoder.temperature, decoder.prior),
            "p_error_raw": probability(log_odds, prior=decoder.prior),
        }
    )
    target = folder / "folds" / fold.test
    write_csv(target / "p_error.csv", table)
    write_csv(target / "training.csv", fitted.history.assign(subject=fold.test))
    write_csv(target / "scores.csv", _score(fold, fitted, table, latencies, settings))
    write_text(target / "fold.json", json.dumps(key) + "\n")
    return time.perf_counter() - start


def _score(fold, fitted, table, latencies, settings):
    decoder, validation = fitted.decoder, fitted.validation
    p_validation = probability(validation["log_odds"], decoder.temperature, decoder.prior)
    rng = np.random.default_rng(settings.seed)
    row = {
        "subject": fold.test,
        "accuracy_pretrain": scores.accuracy(p_validation, validation["label"]),
        **scores.score(
            table["p_error"], table["p_error_raw"], table["label"], decoder.prior,
            settings.n_permutations, rng,
        ),
        "n_epochs": len(table),
        "n_errors": int(table["label"].sum()),
        "temperature": decoder.temperature,
        "prior": decoder.prior,
        "auroc_validation": np.mean(
            [
                scores.auroc(rows["log_odds"].to_numpy(), rows["label"].to_numpy())
                for _, rows in validation.groupby(["network", "subject"])
            ]
        ),
    }  # fmt: skip
    return pd.DataFrame([row])


def _fold_key(fold, settings, input_format, identities):
    """Name everything a fold's results follow from: a hash, and the power of every subject."""
    used = {subject: identities[subject] for subject in (*fold.pool, fold.test)}
    exact = {subject: fingerprint for subject, (fingerprint, _) in used.items()}
    parts = [_VERSION, asdict(fold), asdict(settings), asdict(input_format), exact]
    power = {subject: power for subject, (_, power) in used.items()}
    return {"hash": sha256(canonical_json(parts)), "power": power}


def _is_done(folder, subject, key):
    target = folder / "folds" / subject
    files = [target / f"{name}.csv" for name in TABLES]
    files += [folder / "weights" / f"{subject}.safetensors", target / "fold.json"]
    if not all(file.is_file() for file in files):
        return False
    try:
        found = json.loads(files[-1].read_text())
        return found["hash"] == key["hash"] and all(
            same_power(found["power"][subject], power) for subject, power in key["power"].items()
        )
    except (ValueError, KeyError):
        return False


def _merge(folder, subjects, settings, input_format, hashes):
    """Join the tables of the folds in the order of the subjects."""
    merged = {}
    for name in TABLES:
        parts = [
            pd.read_csv(
                folder / "folds" / subject / f"{name}.csv",
                dtype={"subject": str},
                float_precision="round_trip",
            )
            for subject in subjects
        ]
        merged[name] = pd.concat(parts, ignore_index=True)
        write_csv(folder / f"{name}.csv", merged[name])
    config = {
        "settings": asdict(settings),
        "input_format": asdict(input_format),
        "subjects": subjects,
        "folds": hashes,
    }
    write_text(folder / "config.json", json.dumps(config, indent=1) + "\n")
    return merged["scores"]
