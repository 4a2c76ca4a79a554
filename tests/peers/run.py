"""Runs the peers and ours on concealed cases; see README.md. One process, resumable: a case and peer that the results
hold already is not run again."""

import argparse
import datetime
import importlib.metadata
import json
import os
import pathlib
import platform
import subprocess
import sys
import time

import numpy as np

from choose import Bench, tune
from plant import Averaged, read_rig, run_resolved
from recordings import Recording, rmse

PEERS = ("sindy", "symbolic", "gaussian_process", "network")
PACKAGES = ("numpy", "scipy", "numba", "scikit-learn", "pysindy", "gplearn")


def call(arguments):
    """Runs a program, quietly; its last line on failure. CPU seconds of it."""
    before = os.times()
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, arguments))}: {done.stderr.strip().splitlines()[-1:]}")
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def simulate(trainer, rig, inputs, out):
    """Free run of a rig file over a recording."""
    call([trainer, "simulate", "--rig", rig, "--inputs", inputs, "--out", out])
    return Recording(out).p


class Case:
    """One case: its files, what trainer wrote for it, and its free runs on the held-out recording."""

    def __init__(self, suite, name, label, trainer, work):
        self.truth = json.loads((suite / "truth" / f"{name}.json").read_text())
        self.given = [suite / "cases" / name / r["file"] for r in self.truth["recordings"] if r["role"] == "given"]
        aside = suite / "truth" / name
        self.held_file = aside / "held_out.csv"
        self.held, self.clean = Recording(self.held_file), Recording(aside / "held_out_clean.csv")
        self.label, self.trainer, self.work = f"{label}/{name}", trainer, work / label / name
        self.work.mkdir(parents=True, exist_ok=True)

    def errors(self, run):
        return {"noisy_kpa": rmse(run, self.held.p), "clean_kpa": rmse(run, self.clean.p)}

    def identified(self):
        """The rig that `trainer identify` wrote, made if it is not there."""
        rig = self.work / "identified.toml"
        if not rig.exists():
            call([self.trainer, "identify", "--threads", "1", "--rig", "dual_pressure", *self.given, "--out", rig])
        return rig

    def concealed(self):
        return [{k: e[k] for k in ("kind", "where", "note")} | {"net_kpa": e["size"]["net_kpa"]} for e in self.truth["truth"]]

    def given_rig(self):
        return self.errors(simulate(self.trainer, "dual_pressure", self.held_file, self.work / "as_given.csv"))

    def refitted(self):
        run = simulate(self.trainer, self.identified(), self.held_file, self.work / "refitted.csv")
        twin = run_resolved(read_rig(self.identified()), self.held.p[0], self.held.u)
        return self.errors(run) | {"peers_plant_differs_kpa": rmse(twin, run)}

    def ours(self):
        folder, cpu = self.work / "diagnose", None
        if not (folder / "diagnosis.json").exists():
            cpu = call([self.trainer, "diagnose", "--quick", "--rig", "dual_pressure", *self.given, "--out", folder])
        told = json.loads((folder / "diagnosis.json").read_text())
        run = simulate(self.trainer, folder / "rig.toml", self.held_file, self.work / "ours.csv")
        mechanisms = [{"id": m["id"], "where": m["where"],
                       "parameters": {k: [p["value"], p["low"], p["high"], p["unit"]] for k, p in m["parameters"].items()}}
                      for m in told["mechanisms"]]
        return self.errors(run) | {"verdict": told["verdict"], "summary": told["summary"], "mechanisms": mechanisms,
                                   "rivals": told["rivals"], "cpu_s": cpu}

    def bench(self):
        if not hasattr(self, "_bench"):
            self._bench = Bench(Averaged(read_rig(self.identified())), [Recording(f) for f in self.given])
        return self._bench

    def peer(self, name, seed):
        fitted, keep, summary = tune(self.bench(), name, seed)
        residual = fitted.closure(self.held.u, 0, keep) if fitted else None
        with np.errstate(all="ignore"):
            run = run_resolved(read_rig(self.identified()), self.held.p[0], self.held.u, residual)
        return self.errors(run) | {"chosen": summary}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--suite", type=pathlib.Path, required=True, help="what `hidden_rig make` wrote")
    parser.add_argument("--label", required=True, help="a word for the suite; part of the cases' names")
    parser.add_argument("--only", default="", help="cases, separated by commas; all of them if left out")
    parser.add_argument("--made-with", default="", help="the command that made the suite, for the record")
    parser.add_argument("--commit", default="", help="commit of the trainer, for the record")
    parser.add_argument("--trainer", type=pathlib.Path, required=True)
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder for what trainer writes")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="results; a file for each case")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    only = [c for c in given.only.split(",") if c]
    names = only or sorted(f.stem for f in (given.suite / "truth").glob("case_*.json"))
    given.out.mkdir(parents=True, exist_ok=True)
    for name in names:
        case = Case(given.suite, name, given.label, given.trainer, given.work)
        file = given.out / f"{given.label}_{name}.json"
        result = json.loads(file.read_text()) if file.exists() else {
            "case": case.label, "class": case.truth["class"], "concealed": case.concealed(),
            "noise_kpa": next(r["noise_kpa"] for r in case.truth["recordings"] if r["role"] != "given"),
            "ripple_beats": case.truth["ripple_beats"], "answers": {},
            "made": {"suite": given.made_with, "seed": given.seed, "commit": given.commit,
                     "python": platform.python_version(), "packages": {p: importlib.metadata.version(p) for p in PACKAGES},
                     "date": datetime.date.today().isoformat()}}
        steps = {"as_given": case.given_rig, "refitted": case.refitted, "ours": case.ours}
        steps |= {p: (lambda p=p: case.peer(p, given.seed)) for p in PEERS}
        for step, run in steps.items():
            if step in result["answers"]:
                continue
            t0 = time.perf_counter()
            result["answers"][step] = run()
            aside = file.with_suffix(".part")
            aside.write_text(json.dumps(result, indent=1) + "\n")
            aside.replace(file)
            clean = "/".join(f"{v:.3f}" for v in result["answers"][step]["clean_kpa"])
            print(f"{case.label} {step}: {clean} kPa against the clean trace, {time.perf_counter() - t0:.0f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
