"""Leave-one-subject-out decoding: every subject's p(error) from a decoder that never saw them."""

import json
import os
import warnings
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from rlihf_lib.eeg import scores
from rlihf_lib.eeg.channels import channel_auroc, refuse_leaks
from rlihf_lib.eeg.decoder import Decoder
from rlihf_lib.eeg.fitting import DEFAULTS, fit_fold, passes_at_a_time
from rlihf_lib.eeg.preprocessing import Cohort, Preprocessing
from rlihf_lib.eeg.signals import InputFormat, SubjectEpochs, same_power
from rlihf_lib.eeg.splits import leave_one_subject_out
from rlihf_lib.eeg.streaming import replay
from rlihf_lib.files import (
    SUMS,
    canonical_json,
    check_sums,
    one_at_a_time,
    sha256,
    write_csv,
    write_sums,
    write_text,
)
from rlihf_lib.parallel import in_processes
from rlihf_lib.progress import Progress

SWAPPED = 0.25  # AUROC of a person below which the labels, not the brain, are to be doubted
CHANCE = 0.1  # p of an AUROC above which a person is warned of
TABLES = ("p_error", "training", "scores")  # the last is what `run_loso` returns
_VERSION = 1  # raise when the method changes in anything but its settings
_FOLDS_PER_WORKER = 3  # at least: starting a process costs about as much as a small fold


def recorded_cohort(
    eeg, subjects, events=("correct", "error"), drop_channels=(), phase="zero"
) -> Cohort:
    """The epochs that are decoded: preprocessed, in the reference they were recorded with.

    `events`, names of correct and error, and `drop_channels` are for a folder of one's own; `phase`
    is the filter's (`Preprocessing`).

    Notes
    -----
    The spatial filters can learn the average reference, but once subtracted, what all electrodes
    share is lost: on validation subjects of the NER 2015 feedback potentials AUROC fell from 0.69
    to 0.64. The paper says "re-referencing"; its recordings come referenced to linked mastoids.
    """
    names = dict(zip(("correct_event", "error_event"), events, strict=True))
    drop = tuple(drop_channels)
    settings = Preprocessing(reference="recorded", drop_channels=drop, phase=phase, **names)
    return Cohort(eeg, tuple(subjects), settings)


def train_decoder(cohort: Cohort, settings=DEFAULTS) -> Decoder:
    """Train one decoder on everybody, two people at least, for somebody who is still to come.

    Of a cohort with phase "minimum" it can decode a live stream (`lsl`). Errors as in `run_loso`.
    """
    data, _, input_format = _conditioned(cohort, settings)
    people = ["newcomer", *cohort]
    fold, *_ = leave_one_subject_out(people, settings.ensemble, settings.n_validation)
    decoder, *_ = fit_fold(fold.training_pool(data), input_format, settings)
    if cohort.settings.phase == "minimum":
        decoder.band = cohort.settings.l_freq, cohort.settings.h_freq
    return decoder


def run_loso(cohort, folder, settings=DEFAULTS, workers=0, recompute=False) -> pd.DataFrame:
    """Train one decoder per held-out subject, replay that subject through it, and score.

    A ValueError names the subject that cannot be decoded (channels, rates, NaN, classes), or the
    channel that alone tells the classes apart (`channels.refuse_leaks`), and a remedy. Who is
    decoded the wrong way round, or no better than by chance, is warned of by name.

    Parameters
    ----------
    cohort : Mapping
        Of at least three subjects: subject -> preprocessed `mne.Epochs` with events "correct" and
        "error" and a metadata column `epoch`. Pickled, for workers ask it for the held-out subject.
    folder : Path
        Receives the `TABLES`, config.json and weights/<subject>.safetensors. Finished folds lie in
        folds/<subject>/ and, unless you `recompute`, are skipped by the next call if settings and
        data are the same.
    workers : int
        Processes, one fold each at a time; 0 = as many as there are cores.

    Returns
    -------
    DataFrame
        One row per held-out subject: accuracy_pretrain (validation subjects, each decoded by the
        networks of this fold that did not train on it, p(error) > 0.5), accuracy_online (the
        held-out subject, replayed through the ring buffer), what `scores.score` adds, and more.
    """
    folder = Path(folder)
    with one_at_a_time(folder, folder / "weights", *folder.glob("folds/*")):
        return _run_folds(cohort, folder, settings, workers, recompute)


def _run_folds(cohort, folder, settings, workers, recompute):
    subjects = list(cohort)
    folds = leave_one_subject_out(subjects, settings.ensemble, settings.n_validation)
    data, identities, input_format = _conditioned(cohort, settings)
    keys = {fold.test: _fold_key(fold, settings, input_format, identities) for fold in folds}
    missing = [f for f in folds if recompute or not _is_done(folder, f.test, keys[f.test])]
    (folder / SUMS).unlink(missing_ok=True)  # of weights and tables that are replaced from here on
    run = partial(_run_fold, cohort, input_format, settings, folder)
    jobs = [(fold.training_pool(data), keys[fold.test]) for fold in missing]
    n_processes = min(workers or os.cpu_count() or 1, -(-len(jobs) // _FOLDS_PER_WORKER))
    one_thread = partial(torch.set_num_threads, 1)
    with Progress(len(folds), len(folds) - len(missing), "folds") as progress:
        for subject in in_processes(run, jobs, n_processes, one_thread):
            progress.finished(subject)
    config = {
        "settings": _told(settings),
        "input_format": asdict(input_format),
        "subjects": subjects,
        "folds": {subject: key["hash"] for subject, key in keys.items()},
    }
    read = partial(pd.read_csv, dtype={"subject": str}, float_precision="round_trip")
    for name in TABLES:
        files = [folder / "folds" / subject / f"{name}.csv" for subject in subjects]
        merged = pd.concat(map(read, files), ignore_index=True)
        write_csv(folder / f"{name}.csv", merged)
    write_text(folder / "config.json", json.dumps(config, indent=1) + "\n")
    names = ["config.json", *(f"{name}.csv" for name in TABLES), *map(_weights, subjects)]
    write_sums(folder, names)
    for _, row in merged[merged["auroc_p"] > CHANCE].iterrows():
        what = f"no better than chance (p = {row['auroc_p']:.2f})"
        if row["auroc"] < SWAPPED:
            what = "as if the two events were swapped"
        warnings.warn(
            f"subject {row['subject']}: AUROC {row['auroc']:.2f}, {what}; look at how the "
            "recording codes its events",
            stacklevel=3,
        )
    return merged


def load_decoder(folder, subject) -> Decoder:
    """The decoder that never saw `subject`.

    A FileNotFoundError says if it isn't trained yet, a ValueError if a file has changed since.
    """
    path = Path(folder) / _weights(subject)
    if not (check_sums(folder) and path.is_file()):
        raise FileNotFoundError(f"{path} does not exist yet; run notebook 02_loso_decoder first")
    return Decoder.load(path)


def _weights(subject):
    return f"weights/{subject}.safetensors"


def _fold_files(subject):
    """Files of a finished fold, seen from its folder."""
    return ["fold.json", *(f"{name}.csv" for name in TABLES), f"../../{_weights(subject)}"]


def _conditioned(cohort, settings):
    """By subject what is trained on, and what the signals are recognised by; their format."""
    data: dict[str, tuple] = {}
    identities, aurocs = {}, []
    for subject in cohort:
        epochs = SubjectEpochs.from_mne(subject, cohort[subject], settings.channels)
        if not data:
            input_format = InputFormat.of(epochs, settings.window)
        picked = input_format.pick(epochs)
        aurocs.append(channel_auroc(picked, epochs.labels))
        conditioned = input_format.condition(picked).astype(np.float32)
        data[subject] = conditioned, epochs.labels, input_format.means(picked)
        identities[subject] = epochs.fingerprint(), epochs.power(), len(epochs.labels)
    refuse_leaks(aurocs, input_format.channels, "the epochs")
    return data, identities, input_format


def _run_fold(cohort, input_format, settings, folder, pool, key):
    """Train and score one fold and write its files, its key last; return its subject."""
    subject = pool.fold.test
    decoder, validation, history = fit_fold(pool, input_format, settings)
    target = folder / "folds" / subject
    (target / SUMS).unlink(missing_ok=True)  # until all is new, nothing counts
    decoder.save(folder / _weights(subject))
    # Only now, with everything fitted, is the held-out subject looked at.
    held_out = SubjectEpochs.from_mne(subject, cohort[subject], settings.channels)
    log_odds, _ = replay(decoder, input_format.pick(held_out))
    columns = {
        "subject": subject,
        "epoch": held_out.index,
        "label": held_out.labels,
        "p_error": scores.probability(log_odds, decoder.temperature, decoder.prior),
        "p_error_raw": scores.probability(log_odds, prior=decoder.prior),
    }
    table = pd.DataFrame(columns)
    write_csv(target / "p_error.csv", table)
    write_csv(target / "training.csv", history.assign(subject=subject))
    write_csv(target / "scores.csv", _score(decoder, validation, table, settings))
    write_text(target / "fold.json", json.dumps(key) + "\n")
    write_sums(target, _fold_files(subject))
    return subject


def _score(decoder, validation, table, settings):
    """Row of `run_loso` for one held-out subject."""
    p_validation = scores.probability(validation["log_odds"], decoder.temperature, decoder.prior)
    rng = np.random.default_rng(settings.seed)
    p_error, p_raw, labels = (table[name] for name in ("p_error", "p_error_raw", "label"))
    decoded = validation.groupby(["network", "subject"])[["log_odds", "label"]]
    validated = [scores.auroc(*rows.to_numpy().T) for _, rows in decoded]
    row = {
        "subject": table["subject"][0],
        "accuracy_pretrain": scores.accuracy(p_validation, validation["label"]),
        **scores.score(p_error, p_raw, labels, decoder.prior, settings.n_permutations, rng),
        "n_epochs": len(table),
        "n_errors": int(labels.sum()),
        "temperature": decoder.temperature,
        "prior": decoder.prior,
        "auroc_validation": np.mean(validated),
    }
    return pd.DataFrame([row])


def _told(settings):
    """Settings as folds know them; a key of shipped ones lacks what does nothing in them."""
    told = asdict(settings)
    if not settings.linear:
        del told["linear"]
    return told


def _fold_key(fold, settings, input_format, identities):
    """Name everything a fold's results follow from: a hash, and the power of every subject."""
    subjects = (*fold.pool, fold.test)
    exact, power, counts = ({s: identities[s][part] for s in subjects} for part in (0, 1, 2))
    shortest = min(sum(counts[s] for s in fold.training(n)) for n in range(len(fold.validation)))
    repeats = passes_at_a_time(shortest, settings.batch_size)
    parts = [_VERSION, asdict(fold), _told(settings), asdict(input_format), exact]
    parts += [repeats] if repeats > 1 else []
    return {"hash": sha256(canonical_json(parts)), "power": power}


def _is_done(folder, subject, key):
    target = folder / "folds" / subject
    weights = _fold_files(subject)[-1]
    if not (check_sums(target, may_lack=[weights]) and (target / weights).is_file()):
        return False
    found = json.loads((target / "fold.json").read_text(encoding="utf-8"))
    return found["hash"] == key["hash"] and all(
        same_power(found["power"][person], power) for person, power in key["power"].items()
    )
