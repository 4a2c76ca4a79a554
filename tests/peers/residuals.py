"""The peers: what is missing per chamber, in kPa/s, learnt from what each tick moved beyond the refitted rig.

A residual is a function of commands now and before and of the two pressures. Inputs, scaled to about -1 ... 1:

    static   u_pos, u_neg, p_pos, p_neg
    lags     static, and u(k) - u(k - j) of both valves for j = 1, 2, 4, 8, 16 ticks (up to 0.32 s back)
    warm     static, and both commands through a first-order lag of 60 s that starts from zero with the recording

Targets and inputs of the pressures are smoothed by the same Gaussian, whose width is chosen with everything else.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

LAGS = (1, 2, 4, 8, 16)
WARM_S = 60.0
SETS = ("static", "lags", "warm")
U_MID, U_HALF = np.array([0.7, 0.75]), np.array([0.25, 0.25])
P_MID, P_HALF = np.array([95.0, -72.0]), np.array([30.0, 10.0])


def names(kind):
    """Names of the inputs of a set, in their order."""
    base = ["p_pos", "p_neg", "u_pos", "u_neg"]
    if kind == "lags":
        base += [f"d{j}_{u}" for j in LAGS for u in ("u_pos", "u_neg")]
    if kind == "warm":
        base += ["warm_pos", "warm_neg"]
    return base


def command_inputs(u, kind):
    """The inputs that commands alone decide, [n, ...], from the start of a recording on."""
    columns = [(u - U_MID) / U_HALF]
    if kind == "lags":
        for j in LAGS:
            before = np.vstack([np.repeat(u[:1], j, axis=0), u[:-j]])
            columns.append((u - before) / (0.5 * U_HALF))
    if kind == "warm":
        warm, state, gain = np.empty_like(u), np.zeros(2), 1.0 - np.exp(-0.02 / WARM_S)
        for k in range(len(u)):
            warm[k] = state
            state = state + gain * (u[k] - state)
        columns.append(2.0 * warm - 1.0)
    return np.hstack(columns)


class Learnable:
    """Targets and inputs of all recordings for one set and one width, with the rows that may be fitted."""

    def __init__(self, recordings, targets, kind, width, fitted):
        self.kind, self.runs = kind, []
        for recording, target, rows in zip(recordings, targets, fitted):
            n = len(target)
            smooth = lambda a: gaussian_filter1d(a, width, axis=0, mode="nearest")
            x = np.hstack([smooth((recording.p[:n] - P_MID) / P_HALF), command_inputs(recording.u, kind)[:n]])
            # Smoothing a target mixes in neighbours; rows within two widths of a kept-back row go, too.
            margin = int(np.ceil(2 * width))
            inner = np.convolve(~rows[:n], np.ones(2 * margin + 1), mode="same") < 0.5
            # The first ticks depend on what the pistons did before.
            inner[:5] = False
            self.runs.append((x, smooth(target), inner))

    def stacked(self):
        """Inputs [m, d] and targets [m, 2] of all rows that may be fitted."""
        return (np.vstack([x[rows] for x, _, rows in self.runs]), np.vstack([y[rows] for _, y, rows in self.runs]))


class Fitted:
    """A residual ready to run: `of(inputs of one row) -> (kPa/s positive, kPa/s negative)`."""

    def __init__(self, kind, of, told, formula=None):
        self.kind, self.of, self.told, self.formula = kind, of, told, formula

    def closure(self, u, start=0, keep=(True, True)):
        """residual(k, readings) for a run that begins at row `start` of the commands u of a whole recording."""
        commands = command_inputs(u, self.kind)[start:]
        x = np.empty(2 + commands.shape[1])

        def residual(k, reading):
            # Within twice the range that was seen, or polynomials run away and say nothing of the fit.
            x[:2] = np.clip((reading - P_MID) / P_HALF, -2.5, 2.5)
            x[2:] = commands[k]
            r = self.of(x)
            return (r[0] if keep[0] else 0.0, r[1] if keep[1] else 0.0)

        return residual


# --- SINDy on the discrepancy -------------------------------------------------------------------------------------


def sindy(data, degree, threshold, alpha, _seed):
    """PySINDy's STLSQ on polynomials of states (both pressures) and inputs."""
    import pysindy

    library = pysindy.PolynomialLibrary(degree=degree)
    model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold, alpha=alpha), feature_library=library)
    xs, us, ys = [], [], []
    for x, y, rows in data.runs:
        xs.append(x[rows, :2]), us.append(x[rows, 2:]), ys.append(y[rows])
    model.fit(xs, t=0.02, x_dot=ys, u=us, feature_names=names(data.kind))
    coefficients = np.asarray(model.coefficients())
    used = np.flatnonzero(np.any(coefficients != 0.0, axis=0))
    powers = np.asarray(library.powers_)[used].astype(int)
    # Terms as products of at most `degree` inputs; the input behind the last one is the constant 1.
    d = powers.shape[1] if len(used) else data.runs[0][0].shape[1]
    factors = np.full((len(used), degree), d)
    for t, power in enumerate(powers):
        which = [i for i, n in enumerate(power) for _ in range(n)]
        factors[t, : len(which)] = which
    chosen = coefficients[:, used]
    one = np.ones(d + 1)

    def of(x):
        one[:d] = x
        return chosen @ np.prod(one[factors], axis=1) if len(used) else (0.0, 0.0)

    formula = [sparse_formula(chosen[i], powers, names(data.kind)) for i in range(2)]
    told = {"degree": degree, "threshold": threshold, "alpha": alpha,
            "terms": [int(np.count_nonzero(coefficients[i])) for i in range(2)]}
    return Fitted(data.kind, of, told, formula)


def sparse_formula(coefficients, powers, inputs):
    """A polynomial in words of its scaled inputs."""
    terms = []
    for c, power in sorted(zip(coefficients, powers), key=lambda t: -abs(t[0])):
        if c != 0.0:
            product = " ".join(f"{n}^{p}" if p > 1 else n for n, p in zip(inputs, power) if p)
            terms.append(f"{c:+.3g}{' ' + product if product else ''}")
    return " ".join(terms) if terms else "0"


# --- Symbolic regression ------------------------------------------------------------------------------------------


def symbolic(data, parsimony, population, generations, seed):
    """gplearn, one formula per chamber, on a draw of rows; its output is scaled by least squares on all rows."""
    from gplearn.genetic import SymbolicRegressor

    x, y = data.stacked()
    rows = np.random.default_rng(seed).choice(len(x), size=min(800, len(x)), replace=False)
    programs, scales, formula = [], [], []
    for channel in range(2):
        spread = np.std(y[:, channel]) or 1.0
        search = SymbolicRegressor(
            population_size=population, generations=generations, function_set=("add", "sub", "mul", "div", "abs", "neg"),
            parsimony_coefficient=parsimony, const_range=(-2.0, 2.0), init_depth=(2, 5), random_state=seed + channel,
            feature_names=names(data.kind), n_jobs=1, metric="rmse", p_crossover=0.75, p_subtree_mutation=0.08,
            p_hoist_mutation=0.04, p_point_mutation=0.1)
        search.fit(x[rows], y[rows, channel] / spread)
        value = search._program.execute(x)
        slope, offset = np.polyfit(value, y[:, channel], 1) if np.std(value) > 1e-12 else (0.0, np.mean(y[:, channel]))
        programs.append(search._program), scales.append((slope, offset))
        formula.append(f"{offset:+.3g} {slope:+.3g} * {search._program}")

    def of(row):
        row = row[None, :]
        return [offset + slope * program.execute(row)[0] for program, (slope, offset) in zip(programs, scales)]

    told = {"parsimony": parsimony, "population": population, "generations": generations,
            "length": [int(p.length_) for p in programs]}
    return Fitted(data.kind, of, told, formula)


# --- Gaussian process ---------------------------------------------------------------------------------------------


def gaussian_process(data, rows, inducing, seed):
    """Squared-exponential kernel with a length per input; lengths by marginal likelihood on a draw of rows, the mean by
    the subset of regressors on all of them."""
    from scipy.linalg import cho_factor, cho_solve
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    x, y = data.stacked()
    rng = np.random.default_rng(seed)
    draw = rng.choice(len(x), size=min(rows, len(x)), replace=False)
    base = x[rng.choice(len(x), size=min(inducing, len(x)), replace=False)]
    parts, lengths = [], []
    for channel in range(2):
        spread = np.std(y[:, channel]) or 1.0
        kernel = (ConstantKernel(0.5, (1e-4, 1e2)) * RBF(np.full(x.shape[1], 1.5), (0.2, 1e2))
                  + WhiteKernel(0.5, (1e-3, 1e1)))
        fit = GaussianProcessRegressor(kernel, n_restarts_optimizer=0, random_state=seed)
        fit.fit(x[draw], y[draw, channel] / spread)
        amplitude, length = fit.kernel_.k1.k1.constant_value, fit.kernel_.k1.k2.length_scale
        noise = fit.kernel_.k2.noise_level
        gram = lambda a, b: amplitude * np.exp(-0.5 * np.maximum(
            np.sum(a * a, 1)[:, None] - 2.0 * a @ b.T + np.sum(b * b, 1)[None], 0.0))
        z = base / length
        cross = gram(x / length, z)
        normal = cross.T @ cross + noise * gram(z, z) + 1e-6 * len(x) * np.eye(len(z)) * amplitude
        weights = cho_solve(cho_factor(normal), cross.T @ (y[:, channel] / spread)) * spread * amplitude
        parts.append((length, z, np.sum(z * z, 1), weights)), lengths.append([round(float(v), 2) for v in length])

    def of(row):
        out = []
        for length, z, squares, weights in parts:
            s = row / length
            out.append(float(np.exp(-0.5 * np.maximum(squares - 2.0 * (z @ s) + s @ s, 0.0)) @ weights))
        return out

    return Fitted(data.kind, of, {"rows": rows, "inducing": inducing, "lengths": lengths})


# --- Small network ------------------------------------------------------------------------------------------------


def network(data, width, alpha, seed):
    """Two hidden tanh layers, both chambers in one network, Adam, stopped early on a tenth of its rows."""
    from sklearn.neural_network import MLPRegressor

    x, y = data.stacked()
    spread = np.maximum(np.std(y, axis=0), 1e-9)
    net = MLPRegressor(hidden_layer_sizes=(width, width), activation="tanh", alpha=alpha, batch_size=256, learning_rate_init=2e-3,
                       max_iter=80, early_stopping=True, n_iter_no_change=8, random_state=seed)
    net.fit(x, y / spread)
    (a, b, c), (p, q, r) = net.coefs_, net.intercepts_
    c, r = c * spread, r * spread
    of = lambda row: np.tanh(np.tanh(row @ a + p) @ b + q) @ c + r
    return Fitted(data.kind, of, {"width": width, "alpha": alpha, "epochs": int(net.n_iter_)})
