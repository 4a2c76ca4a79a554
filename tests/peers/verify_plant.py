"""How far the peers' plant lies from `trainer simulate`: python verify_plant.py TRAINER RIG RECORDING"""

import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

from plant import Averaged, read_rig, run_resolved
from recordings import Recording, rmse


def distance(trainer, rig, recording):
    """RMS difference per channel of the resolved and of the averaged form (kPa)."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "simulated.csv"
        subprocess.run([trainer, "simulate", "--rig", rig, "--inputs", recording, "--out", out],
                       check=True, stdout=subprocess.DEVNULL)
        theirs, given = Recording(out).p, Recording(recording)
    q = read_rig(rig)
    t0 = time.perf_counter()
    fine = run_resolved(q, given.p[0], given.u)
    t1 = time.perf_counter()
    averaged = Averaged(q)
    t2 = time.perf_counter()
    _, correction = averaged.one_step(given.p, given.u)
    coarse = averaged.free_run(given.p[0], given.u, correction=correction)
    t3 = time.perf_counter()
    return {"resolved_kpa": rmse(fine, theirs), "averaged_kpa": rmse(coarse, theirs),
            "largest_resolved_kpa": [float(v) for v in np.max(np.abs(fine - theirs), axis=0)],
            "seconds": [t1 - t0, t2 - t1, t3 - t2]}


if __name__ == "__main__":
    print(distance(*sys.argv[1:4]))
