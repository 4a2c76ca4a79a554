"""The dual-pressure rig for Python.

simulate(rig, u_pos, u_neg)         open-loop simulation of a rig of the paper's kind under given duties
simulate_recording(rig, columns)    the same for any rig, under the commands of a recording
read_recording(file, rig)           a recording of the daemon, or any file its reader reads, as NumPy arrays
read_ticks(file)                    every number of every tick of a recording of the daemon
DualPressureEnv(rig, model)         the rig as a Gymnasium environment (needs gymnasium)

A rig is a built-in name ("dual_pressure", the paper's; "bench", as built) or the path of a TOML file. Pressures are
kPa gauge, duties 0 (shut) to 1 (open vent), times seconds, a tick is 20 ms. What cannot be done raises ValueError
with one line that says what is wrong and what would help.
"""

import os
import warnings

import numpy as np

from . import _native

TICK_S = 0.02
# Integrator steps per step of the rig file, as `trainer simulate --refine` has them.
REFINE = _native.REFINE
__all__ = ["TICK_S", "DualPressureEnv", "Recording", "read_recording", "read_ticks", "simulate", "simulate_recording"]


class Recording(dict):
    """Columns by name, as read_recording gives them: NumPy arrays of float, or lists of str for columns of text.

    source      the file
    measured    bool by row: False between sparse samples or in the place of a lost one, where a reading is a straight
                line between its neighbours and no evidence
    notes       what the reader found out or left out, a line of text each
    """

    def __init__(self, columns, source, measured, notes):
        super().__init__(columns)
        self.source, self.measured, self.notes = source, measured, notes


def simulate(rig, u_pos, u_neg, pump_on=None, start_kpa=None, refine=REFINE):
    """Pressures of a rig under given duties, as `trainer simulate` works them out.

    rig         a built-in name ("dual_pressure", "bench") or a TOML file
    u_pos/neg   duties, shape [ticks], one for each 20 ms
    pump_on     shape [ticks] of bool; left out, the pump runs
    start_kpa   (positive, negative) in kPa gauge; left out, the rig starts at rest
    refine      integrator steps per step of the rig file; 1 is faster and what the daemon's model does

    Returns (p_pos_kpa, p_neg_kpa), shape [ticks] each: row k is the reading when the duties of row k begin to act.
    Raises ValueError with one line that names what is wrong.
    """
    u_pos, u_neg = _row("u_pos", u_pos), _row("u_neg", u_neg)
    ticks = len(u_pos)
    if len(u_neg) != ticks:
        raise ValueError(f"u_pos has {ticks} duties and u_neg {len(u_neg)}; give one of each for every tick of 20 ms")
    columns = {"time_s": TICK_S * np.arange(ticks), "u_pos": u_pos, "u_neg": u_neg}
    if pump_on is not None:
        columns["pump_on"] = _row("pump_on", pump_on)
        if len(columns["pump_on"]) != ticks:
            raise ValueError(f"pump_on has {len(columns['pump_on'])} ticks and u_pos {ticks}; give one for every duty")
        if not np.isin(columns["pump_on"], (0.0, 1.0)).all():
            raise ValueError("pump_on is True or False (1 or 0) in every tick")
    if start_kpa is not None:
        start = np.asarray(start_kpa, dtype=float)
        if start.shape != (2,):
            raise ValueError(f"start_kpa is (positive, negative) in kPa gauge, not {start_kpa!r}")
        columns["p_pos_kpa"], columns["p_neg_kpa"] = np.full(ticks, start[0]), np.full(ticks, start[1])
    pressures = simulate_recording(rig, columns, refine)
    missing = [name for name in ("p_pos_kpa", "p_neg_kpa") if name not in pressures]
    if missing:
        raise ValueError(f"{rig}: no sensor uses column {' or '.join(missing)}; simulate_recording takes rigs of any kind")
    return pressures["p_pos_kpa"], pressures["p_neg_kpa"]


def simulate_recording(rig, columns, refine=REFINE):
    """Pressures of any rig under the commands of a recording, as `trainer simulate` works them out.

    rig       a built-in name or a TOML file
    columns   a mapping of columns: what read_recording gives, or "time_s" and the commands the rig asks for by their
              names; where it has the rig's pressures, the run starts at their first row, otherwise at rest
    refine    integrator steps per step of the rig file; 1 is faster and what the daemon's model does

    Returns a dict of the rig's pressures by column, kPa gauge, a number for each row.
    Raises ValueError with one line that names what is wrong.
    """
    if not (isinstance(refine, (int, np.integer)) and 1 <= refine <= 100):
        raise ValueError(f"refine is a whole number within 1 ... 100, not {refine!r}")
    numbers = [(name, _bytes(_row(name, c))) for name, c in columns.items() if _is_numbers(c)]
    return _arrays(_native.simulate(_rig_name(rig), numbers, int(refine)))


def read_recording(file, rig="dual_pressure"):
    """A recording by column, read as every command of `trainer` reads it: rows of 20 ms, whatever rate the file has.

    file   MCAP of the daemon, or a table that another program wrote: CSV and other text, LabVIEW .lvm, MATLAB .mat (up
           to -v7), any of them compressed with gzip or zstd
    rig    the rig that the columns are for: a built-in name, or a rig file whose [recording] table maps foreign names
           and units; the built-in ones take the daemon's names

    Returns a Recording: a dict with "time_s" and the columns, and what the reader has to tell as its attributes and as
    warnings. Raises ValueError with one line that names file, line or column, and the key that would help.
    An MCAP file gives the rows that every command reads, those with both pressures and a command, and references only
    where every row has them; read_ticks gives all.
    """
    columns, measured, notes = _native.read_recording(os.fsdecode(file), _rig_name(rig))
    return Recording(_arrays(columns), _path(file), np.frombuffer(measured, dtype=np.uint8).astype(bool), _told(notes))


def read_ticks(file):
    """Every number of every tick of a recording of the daemon (MCAP), as `controller export --all` has them.

    Returns a Recording: "time_s" and the fields of /tick (docs/recordings.md) as arrays of float, NaN where there was
    no number; arrays of the message have their index behind their name, from 1. Whole numbers above 2**53 (findings,
    hashes) are rounded. Raises ValueError with one line that names the file.
    """
    columns, notes = _native.read_ticks(os.fsdecode(file))
    arrays = _arrays(columns)
    return Recording(arrays, _path(file), np.ones(len(arrays["time_s"]), dtype=bool), _told(notes))


def _path(name):
    # A built-in name is a str, a file a str or a path; anything else is said to be wrong by os.fspath.
    return os.fsdecode(name)


def _rig_name(rig):
    """A built-in name or a rig file's path, which messages and recordings must be able to carry as text."""
    name = os.fsdecode(rig)
    try:
        name.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name!r}: the path of a rig file must be UTF-8; rename the file or its folder") from None
    return name


def _arrays(columns):
    return {n: c if isinstance(c, list) else np.frombuffer(c, dtype="<f8").copy() for n, c in columns}


def _told(notes):
    for note in notes:
        # Of the line that called the function that called this one.
        warnings.warn(note, stacklevel=3)
    return notes


def _is_numbers(column):
    kind = np.asarray(column).dtype.kind
    return kind in "biuf"


def _row(name, values):
    values = np.asarray(values)
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be a row of numbers, one for each tick; it is {values.dtype} of shape {values.shape}")
    return values.astype(float)


def _bytes(values):
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def __getattr__(name):
    # Gymnasium is only needed by those who train.
    if name == "DualPressureEnv":
        from .env import DualPressureEnv

        return DualPressureEnv
    raise AttributeError(f"module 'dual_pressure' has no attribute {name!r}")
