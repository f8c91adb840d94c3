"""Names of channels and their places on the head, whatever file they come from."""

import mne
import numpy as np

REMEDY = (
    "leave it out with --drop-channels {names}, or give it its true type in the file "
    "(epochs.set_channel_types), such as misc"
)


def require_channels(names, required, path):
    """Refuse a recording that lacks one of the `required` channels.

    Raises
    ------
    ValueError
        Naming the file and the channels.
    """
    missing = [name for name in required if name not in names]
    if missing:
        raise ValueError(
            f"{path}: channel {', '.join(missing)} is missing (it has {', '.join(names)}); "
            "rename or interpolate it in the file"
        )


def set_positions(instance):
    """Give EEG channels without a position the one of the 10-05 system, by their name.

    Channels with a position of their own keep it.
    """
    eeg = [
        instance.info["chs"][pick] for pick in mne.pick_types(instance.info, eeg=True, exclude=())
    ]
    own = {channel["ch_name"]: channel["loc"][:3].copy() for channel in eeg if is_located(channel)}
    if len(own) == len(eeg):
        return
    head = [
        mne.channels.transform_to_head(mne.channels.make_standard_montage(name)).get_positions()
        for name in ("standard_1020", "standard_1005")
    ]
    # The 10-20 system has O9 and O10 beside those of the 10-05; what both have is equal.
    named = {n.lower(): place for system in head for n, place in system.pop("ch_pos").items()}
    lost = [channel["ch_name"] for channel in eeg if channel["ch_name"] not in own]
    found = {name: named[name.lower()] for name in lost if name.lower() in named}
    landmarks = {name: head[1][name] for name in ("nasion", "lpa", "rpa", "coord_frame")}
    # One montage for all: a second one would take from the others what they have.
    montage = mne.channels.make_dig_montage(own | found, **landmarks)
    instance.set_montage(montage, on_missing="ignore", verbose="error")


def refuse_unlocated(info, path):
    """Refuse EEG channels that have no place on the scalp: triggers, labels, sensors.

    Parameters
    ----------
    info : mne.Info
        After `set_positions`.
    path : str or Path
        For the message.

    Raises
    ------
    ValueError
        Names the channels without a position of their own or of the 10-05 system, and the remedy.
    """
    kinds = zip(info.get_channel_types(), info["chs"], strict=True)
    lost = [c["ch_name"] for kind, c in kinds if kind == "eeg" and not is_located(c)]
    if lost:
        raise ValueError(
            f"{path}: EEG channel {', '.join(lost)} has no position, neither in the file nor by a "
            f"name of the 10-05 system; {REMEDY.format(names=' '.join(lost))}"
        )


def is_located(channel):
    """Whether a channel, an entry of `info["chs"]`, has a place."""
    place = channel["loc"][:3]
    return bool(np.isfinite(place).all() and place.any())
