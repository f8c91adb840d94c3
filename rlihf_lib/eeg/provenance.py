"""Where each parameter of the simulated recordings comes from."""

from dataclasses import fields

import pandas as pd

from rlihf_lib.eeg.simulated import MODEL

_CALIBRATED = "calibrated: "
ORIGINS = {
    "feedback": "visual P1, N1, P2 and P3 at textbook latencies; the same for both outcomes",
    "error": "latencies and signs at Cz: Ehrlich & Cheng 2019; sites: error negativity fronto-"
    "central, positivity centro-parietal; moments " + _CALIBRATED + "peak over SD 0.59, "
    "and how many subjects' largest peak is the negativity (largest peak at 282 +- 40 ms)",
    "jitter": "assumed, some 20 ms between trials",
    "trial_spread": "assumed",
    "lapse": "assumed; the best subject (.98) leaves no room for more",
    "frequent": "smaller error potentials where errors are frequent (direction published, size "
    "assumed)",
    "subject_latency": _CALIBRATED + "spread of the AUROC across subjects",
    "subject_spread": _CALIBRATED + "accuracy within (.91) against across subjects",
    "subject_position": _CALIBRATED + "accuracy within (.91) against across subjects",
    "subject_direction": _CALIBRATED + "accuracy within (.91) against across subjects",
    "background": "usual amplitude of awake EEG, RMS",
    "exponent": "usual slope of the EEG spectrum",
    "background_spread": "assumed",
    "alpha": "usual amplitude of alpha with eyes open",
    "noise": "active electrodes and amplifier, below 1 uV",
    "blinks": "9 per minute",
    "human_error": "a few in 500 (documentation of the data set)",
    "resolution": "order of a 24-bit amplifier's least significant bits",
    "people": _CALIBRATED + "gain and oddness of each subject, so that its AUROC across subjects "
    "is near the published one; latencies spread as the published peak (SD 40 ms)",
    "seed": "arbitrary, fixed before calibration",
}


def parameter_table(model=MODEL):
    """Parameters of the simulation, their values and where each comes from.

    Returns
    -------
    pandas.DataFrame
        Columns value and origin, one row per field of `simulated.Model`.
    """
    rows = {}
    for field in fields(model):
        value = getattr(model, field.name)
        if field.name in ("feedback", "error"):
            value = ", ".join(f"{c.name} {1000 * c.latency:.0f} ms {c.moment} nAm" for c in value)
        elif field.name == "people":
            value = ", ".join(f"{k} {g}/{1000 * s:+.0f} ms/{o}" for k, (g, s, o) in value.items())
        rows[field.name] = (value, ORIGINS[field.name])
    return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "origin"])
