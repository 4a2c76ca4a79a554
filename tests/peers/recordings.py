"""Reading recordings (`time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa`, a row every 20 ms)."""

import numpy as np


class Recording:
    """Commands u [n, 2] (duty) and readings p [n, 2] (kPa gauge); row k's command acts from t_k to t_{k+1}."""

    def __init__(self, path):
        with open(path) as file:
            header = file.readline().strip().split(",")
        rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        column = lambda name: rows[:, header.index(name)]
        self.u = np.ascontiguousarray(np.column_stack([column("u_pos"), column("u_neg")]))
        self.p = np.ascontiguousarray(np.column_stack([column("p_pos_kpa"), column("p_neg_kpa")]))


def rmse(run, truth):
    """Root mean square error per channel, kPa."""
    return [float(v) for v in np.sqrt(np.mean((run - truth) ** 2, axis=0))]
