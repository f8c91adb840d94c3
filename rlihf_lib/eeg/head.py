"""Spherical head model: how a current dipole in the brain shows at the electrodes."""

from functools import lru_cache

import mne
import numpy as np

from rlihf_lib.eeg.dataset import CHANNELS

#: Electrode of the 10-20 system nearest to each EOG electrode: outer canthi and central forehead.
_EOG_PLACES = {"EOG1": "AF9", "EOG2": "AF10", "EOG3": "Fpz"}
_MASTOIDS = ("TP9", "TP10")


@lru_cache
def _model():
    """Electrodes (MNE Info), sphere model, its centre and head radius in m."""
    places = [_EOG_PLACES.get(name, name) for name in (*CHANNELS, *_MASTOIDS)]
    info = mne.create_info(places, 256.0, "eeg")
    info.set_montage("standard_1020", verbose="error")
    sphere = mne.make_sphere_model("auto", "auto", info, verbose="error")
    return info, sphere, sphere["r0"], sphere.radius


def lead_field(positions):
    """Potentials of unit dipoles at the 30 electrodes, against the mean of TP9 and TP10.

    Parameters
    ----------
    positions : array_like, shape (n, 3)
        From the centre of the sphere, in units of the head's radius: x to the right ear, y to the
        nose, z up. Norm below 0.9, inside the brain's sphere.

    Returns
    -------
    ndarray, shape (30, n, 3)
        Microvolts per nAm along x, y and z.

    Notes
    -----
    Four concentric spheres (brain, cerebrospinal fluid, skull, scalp; MNE's default conductivities)
    fitted to the ``standard_1020`` electrodes.
    """
    info, sphere, centre, radius = _model()
    positions = centre + radius * np.atleast_2d(positions)
    source = mne.setup_volume_source_space(
        pos={"rr": positions, "nn": np.tile([0.0, 0.0, 1.0], (len(positions), 1))}, verbose="error"
    )
    forward = mne.make_forward_solution(
        info,
        mne.transforms.Transform("head", "mri"),
        source,
        sphere,
        meg=False,
        mindist=0.0,
        verbose="error",
    )
    # MNE gives V per Am, which is 1e-3 uV per nAm.
    gain = forward["sol"]["data"].reshape(len(info.ch_names), -1, 3) * 1e-3
    return gain[: len(CHANNELS)] - gain[len(CHANNELS) :].mean(axis=0)
