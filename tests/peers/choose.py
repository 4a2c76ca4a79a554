"""Tuning in good faith: every peer is fitted to two thirds of the given recordings in several forms, each form runs
freely with the refitted rig over the kept-back thirds, the best is fitted again to everything.

A residual is kept for both chambers, for one, or for none: whatever ran best. None means that the peer says nothing.
"""

import time
import warnings

import numpy as np

import residuals
from residuals import Learnable

BLOCK = 250  # rows: 5 s
KEPT_BACK = 3  # every third block, from the first
KEEPS = ((True, True), (True, False), (False, True))


def blocks(n):
    """Starts and ends of the kept-back blocks of a recording of n rows."""
    return [(s, min(s + BLOCK, n)) for i, s in enumerate(range(0, n, BLOCK)) if i % KEPT_BACK == 0 and n - s >= 50]


def rows_to_fit(n):
    """Which rows may be fitted while forms are compared."""
    rows = np.ones(n, bool)
    for start, end in blocks(n):
        rows[start:end] = False
    return rows


class Bench:
    """The recordings of a case with the refitted rig: fits forms and runs them."""

    def __init__(self, averaged, recordings):
        self.averaged, self.recordings = averaged, recordings
        both = [averaged.one_step(r.p, r.u) for r in recordings]
        self.targets, self.corrections = [b[0] for b in both], [b[1] for b in both]
        self.cache = {}

    def data(self, kind, width, everything=False):
        key = (kind, width, everything)
        if key not in self.cache:
            rows = [np.ones(len(r.u), bool) if everything else rows_to_fit(len(r.u)) for r in self.recordings]
            self.cache[key] = Learnable(self.recordings, self.targets, kind, width, rows)
        return self.cache[key]

    def error(self, fitted, keep=(True, True)):
        """Mean squared error per channel (kPa^2) of free runs over the kept-back blocks."""
        squares, count = np.zeros(2), 0
        for r, correction in zip(self.recordings, self.corrections):
            for start, end in blocks(len(r.u)):
                residual = fitted.closure(r.u, start, keep) if fitted else None
                with np.errstate(all="ignore"):
                    run = self.averaged.free_run(r.p[start], r.u[start:end], residual, correction[start:end])
                error = run - r.p[start:end]
                squares += np.sum(np.where(np.isfinite(error), np.minimum(error**2, 1e4), 1e4), axis=0)
                count += end - start
        return squares / count


def forms(peer, seed):
    """The forms of a peer that are compared: (set of inputs, width of smoothing, fit)."""
    out = []
    if peer == "sindy":
        for kind, degrees in (("static", (1, 2, 3)), ("lags", (1, 2)), ("warm", (2,))):
            for degree in degrees:
                for threshold in (0.05, 0.2, 0.6):
                    out.append((kind, 2.0, lambda d, g=degree, t=threshold: residuals.sindy(d, g, t, 1e-3, seed)))
    elif peer == "symbolic":
        for kind, parsimony in (("static", 0.002), ("lags", 0.002), ("lags", 0.0005), ("warm", 0.002)):
            out.append((kind, 4.0, lambda d, p=parsimony: residuals.symbolic(d, p, 400, 14, seed)))
    elif peer == "gaussian_process":
        for kind in residuals.SETS:
            out.append((kind, 2.0, lambda d: residuals.gaussian_process(d, 300, 300, seed)))
    elif peer == "network":
        for kind in residuals.SETS:
            for alpha in (0.1, 1.0, 10.0):
                out.append((kind, 2.0, lambda d, a=alpha: residuals.network(d, 24, a, seed)))
    else:
        raise ValueError(f"no peer is called {peer}")
    return out


def tune(bench, peer, seed):
    """The best form of a peer, fitted to everything, what it keeps, and how it was chosen."""
    t0 = time.process_time()
    nothing = bench.error(None)
    tried = []
    warnings.simplefilter("ignore")
    for index, (kind, width, fit) in enumerate(forms(peer, seed)):
        fitted = fit(bench.data(kind, width))
        tried.append((float(np.sum(bench.error(fitted))), index, fitted))
    tried.sort(key=lambda t: t[:2])
    best = (float(np.sum(nothing)), None, (False, False))
    for score, index, fitted in tried[:2]:
        for keep in KEEPS:
            score = float(np.sum(bench.error(fitted, keep)))
            if score < best[0]:
                best = (score, index, keep)
    score, index, keep = best
    summary = {"forms": len(tried), "kept_back_rmse_kpa": {"refitted": float(np.sqrt(np.sum(nothing) / 2)),
               "best": float(np.sqrt(score / 2))}, "keeps": {"positive": keep[0], "negative": keep[1]}}
    final = None
    every = forms(peer, seed)
    summary["all"] = [[every[i][0], every[i][1], t.told, round(float(np.sqrt(e / 2)), 4)] for e, i, t in tried]
    if index is not None:
        kind, width, fit = every[index]
        final = fit(bench.data(kind, width, everything=True))
        summary |= {"inputs": kind, "smoothing_ticks": width, "form": final.told}
        if final.formula:
            summary["formula"] = {place: f for place, f, kept in zip(("positive", "negative"), final.formula, keep) if kept}
    summary["cpu_s"] = round(time.process_time() - t0, 1)
    return final, keep, summary
