"""Continuous EEGLAB recordings, read strictly: the built-in sources come as such files."""

import contextlib
import re
import struct
import zlib
from pathlib import Path

import mne

from rlihf_lib.eeg.channels import set_positions
from rlihf_lib.eeg.quality import refuse_nan, refuse_vast

_COMPRESSED = 15  # MATLAB's type of a part that is packed by zlib


def read_eeglab(path) -> mne.io.RawArray:
    """Read a continuous EEGLAB recording strictly, its data in the `.set` or a `.fdt` beside it.

    Channels are typed (names with EOG are ``eog``, all others ``eeg``) and have the 10-05 positions
    of their names; repeated EOG labels are numbered. Events are annotations, without those past
    the end of the data, of which MNE warns. Integers and digits, ``4``, are taken as the
    BrainVision marker they stand for, ``S  4``. A FileNotFoundError says if a file is missing, a
    ValueError if one is truncated, not EEGLAB's, epoched, holds NaN, or repeats an EEG channel.
    """
    path = Path(path)
    refuse_vast(unpacked_size(path), path)
    try:
        recorded = mne.io.read_raw_eeglab(path, verbose="warning")
    except FileNotFoundError:
        raise
    except Exception as problem:
        raise ValueError(
            f"{path} is not a readable continuous EEGLAB recording ({problem}); if it is truncated "
            "copy it anew, if it is epoched or in MATLAB v7.3 form save it in EEGLAB as continuous "
            "data with the option 'Save files in v6 format' (File > Preferences)"
        ) from problem
    names = _channel_names(recorded.ch_names, path)
    require_whole(recorded)
    data, sfreq = recorded.get_data(), recorded.info["sfreq"]
    refuse_nan(data, names, sfreq, path)
    types = ["eog" if "EOG" in name.upper() else "eeg" for name in names]
    raw = mne.io.RawArray(data, mne.create_info(names, sfreq, types), verbose="error")
    set_positions(raw)
    events = recorded.annotations
    raw.set_annotations(mne.Annotations(events.onset, 0, list(map(_marker, events.description))))
    return raw


def unpacked_size(path) -> int:
    """Bytes of a MATLAB file with its compressed parts unpacked, by what they say of themselves."""
    total = 0
    with Path(path).open("rb") as file:
        order = ">" if file.read(128)[126:] == b"MI" else "<"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}2I", tag)
            end = file.tell() + size
            if kind == _COMPRESSED:
                with contextlib.suppress(zlib.error, struct.error):  # damaged, as MNE will say
                    inner = zlib.decompressobj().decompress(file.read(min(size, 1024)), 8)
                    size = struct.unpack(f"{order}2I", inner)[1]
            total += size
            file.seek(end)
    return total


def require_whole(raw) -> None:
    """Refuse a continuous EEGLAB recording whose `.fdt` is not as long as its `.set` says."""
    file, expected = Path(raw.filenames[0]), len(raw.ch_names) * raw.n_times * 4
    if file.suffix == ".fdt" and (size := file.stat().st_size) != expected:
        raise ValueError(
            f"{file} has {size} bytes, expected {expected} ({len(raw.ch_names)} channels x "
            f"{raw.n_times} samples x 4 bytes); it is truncated or belongs to "
            "another .set, copy it anew"
        )


def _channel_names(names, path):
    """Labels as in the file, where MNE has numbered those that it repeats: EOG-0, EOG-1."""
    labels = [re.sub(r"-\d+$", "", name) for name in names]
    repeated = {label for label in labels if labels.count(label) > 1}
    refused = sorted(label for label in repeated if "EOG" not in label.upper())
    if refused:
        raise ValueError(f"{path}: channel {', '.join(refused)} occurs twice; rename one of them")
    numbers = iter(range(1, len(names) + 1))
    return [f"EOG{next(numbers)}" if repeated and "EOG" in name.upper() else name for name in names]


def _marker(kind):
    """Name of an event in BrainVision's form: S6, 6 and 6.0 are "S  6"."""
    marker = re.fullmatch(r"([SR]?)\s*(\d+)(?:\.0)?", kind.strip())
    return f"{marker[1] or 'S'}{int(marker[2]):3d}" if marker else kind.strip()
