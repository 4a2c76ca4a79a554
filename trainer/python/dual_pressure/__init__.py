"""The dual-pressure rig for Python.

simulate(rig, u_pos, u_neg)      open-loop simulation of a rig file or a built-in rig
read_recording(file)             a recording of the daemon, or any file its reader reads, as NumPy arrays
DualPressureEnv(rig, model)      the rig as a Gymnasium environment (needs gymnasium)

Pressures are kPa gauge, duties 0 (shut) to 1 (open vent), times seconds, a tick is 20 ms.
"""

import numpy as np

from . import _native

TICK_S = 0.02
__all__ = ["TICK_S", "DualPressureEnv", "read_recording", "simulate"]


def _doubles(values):
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def simulate(rig, u_pos, u_neg, pump_on=None, start_kpa=None):
    """Pressures of a rig under given duties, as `trainer simulate` works them out.

    rig         a built-in name ("dual_pressure", "bench") or a TOML file
    u_pos/neg   duties, shape [ticks], one for each 20 ms
    pump_on     shape [ticks] of bool; left out, the pump runs
    start_kpa   (positive, negative) in kPa gauge; left out, the rig starts at rest

    Returns (p_pos_kpa, p_neg_kpa), shape [ticks] each: row k is the reading when the duties of row k begin to act.
    Raises ValueError with one line that names what is wrong.
    """
    u_pos, u_neg = np.asarray(u_pos, dtype=float), np.asarray(u_neg, dtype=float)
    if u_pos.ndim != 1 or u_pos.shape != u_neg.shape:
        raise ValueError(f"u_pos and u_neg must be one-dimensional and alike, not {u_pos.shape} and {u_neg.shape}")
    if pump_on is not None:
        pump_on = np.asarray(pump_on, dtype=bool)
        if pump_on.shape != u_pos.shape:
            raise ValueError(f"pump_on must have the shape of u_pos {u_pos.shape}, not {pump_on.shape}")
        pump_on = pump_on.astype(np.uint8).tobytes()
    start = None if start_kpa is None else (float(start_kpa[0]), float(start_kpa[1]))
    out = np.frombuffer(_native.simulate(str(rig), _doubles(u_pos), _doubles(u_neg), pump_on, start), dtype="<f8")
    return out[: len(u_pos)].copy(), out[len(u_pos) :].copy()


def read_recording(file, rig=None):
    """A recording as a dict of columns: NumPy arrays of float, or lists of str for columns of text.

    file   MCAP of the daemon, or any table that `trainer` reads
    rig    a rig file whose [recording] table maps foreign names and units; left out, the names are the daemon's

    "time_s" is always there. Raises ValueError with one line that names file, line or column.
    """
    columns = _native.read_recording(str(file), None if rig is None else str(rig))
    return {n: c if isinstance(c, list) else np.frombuffer(c, dtype="<f8").copy() for n, c in columns}


def __getattr__(name):
    # Gymnasium is only needed by those who train.
    if name == "DualPressureEnv":
        from .env import DualPressureEnv

        return DualPressureEnv
    raise AttributeError(f"module 'dual_pressure' has no attribute {name!r}")
