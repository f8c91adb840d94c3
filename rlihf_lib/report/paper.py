"""The paper's numbers, in one place, so that ours are always shown beside them.

S. Kim, H.-B. Shin and S.-W. Lee, "Aligning Humans and Robots via Reinforcement Learning from
Implicit Human Feedback".
"""

import numpy as np
import pandas as pd

PHASES = ("Early", "Mid", "Late")
CONDITIONS = ("sparse", "dense", "rlihf")
METRICS = ("success", "path_efficiency", "path_deviation")

# Table I, mean and standard deviation of each metric; path deviation without a unit, presumably
# metres. Sparse, dense and RLIHF early, then mid, then late.
_TABLE_I = (
    ((0.00, 0.00), (0.36, 0.20), (0.74, 0.26)),
    ((0.06, 0.18), (0.60, 0.31), (0.50, 0.32)),
    ((0.02, 0.12), (0.59, 0.29), (0.48, 0.20)),
    ((0.01, 0.05), (0.48, 0.28), (0.53, 0.21)),
    ((0.25, 0.41), (0.71, 0.27), (0.40, 0.14)),
    ((0.17, 0.30), (0.57, 0.23), (0.45, 0.19)),
    ((0.00, 0.00), (0.60, 0.29), (0.52, 0.17)),
    ((0.54, 0.45), (0.74, 0.24), (0.43, 0.07)),
    ((0.39, 0.39), (0.59, 0.21), (0.45, 0.10)),
)


#: Of decoders of single people, "typically" (text beside Fig. 5).
ACCURACY = (0.7, 0.9)


def table_1() -> pd.DataFrame:
    """Return Table I: phase, group, metric, paper_mean, paper_sd; 27 rows."""
    keys = pd.MultiIndex.from_product(
        [PHASES, CONDITIONS, METRICS], names=["phase", "group", "metric"]
    )
    values = np.reshape(_TABLE_I, (-1, 2))
    return pd.DataFrame(values, keys, ["paper_mean", "paper_sd"]).reset_index()
