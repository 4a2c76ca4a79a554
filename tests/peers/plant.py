"""The paper's plant as the peers see it: written from its equations (1) to (7), sharing no code with the workspace.

Two forms. `run_resolved` turns the crank at 0.1 ms with RK4, as the paper does; every figure that is told comes from it.
`Averaged` holds mean pump flows over a revolution in a table over the two chamber pressures; residuals are computed and
chosen with it, some hundred times as fast. Pressures are absolute and in kPa, areas in mm^2, flows in kg/s times R
(kPa m^3 / K / s), so that dP/dt = T/V times their sum. A residual is kPa/s added to a chamber, held for a tick.
"""

import math
import tomllib

import numba
import numpy as np

TICK_S = 0.02
KAPPA = 1.4
R_GAS = 287.0

# Places of the numbers in a packed rig.
(ATM, T_ATM, V_POS, V_NEG, T_CH, RPM, RADIUS, ROD, DELTA, HEAD, T_PIS, C_IN, C_OUT,
 CU_P, CP_P, CK_P, CU_N, CP_N, CK_N, AN_P, AN_N) = range(21)


def read_rig(path):
    """A rig file of the paper's layout, packed in kPa, m^3, K, m^2. Refuses what this plant has not."""
    with open(path, "rb") as file:
        rig = tomllib.load(file)
    if rig.get("mechanisms"):
        raise ValueError(f"{path}: the peers' plant is the nominal one; it has no mechanisms")
    pump, vp, vn = rig["pumps"]["pump"], rig["valves"]["valve_pos"], rig["valves"]["valve_neg"]
    if [round(p) for p in pump["phases_deg"]] != [0, 180]:
        raise ValueError(f"{path}: two pistons at 0 and 180 degrees are assumed")
    if abs(pump["speed_rpm"] - 3000.0) > 1e-6:
        raise ValueError(f"{path}: 3000 rpm (a revolution a tick) is assumed, not {pump['speed_rpm']}")
    nozzle = lambda v: math.pi * (v["nozzle_diameter_mm"] * 1e-3) ** 2 / 4.0
    q = np.zeros(21)
    q[ATM], q[T_ATM] = rig["atmosphere"]["pressure_kpa_abs"], rig["atmosphere"]["temperature_k"]
    q[V_POS], q[V_NEG] = rig["volumes"]["positive"]["volume_l"] * 1e-3, rig["volumes"]["negative"]["volume_l"] * 1e-3
    q[T_CH] = rig["volumes"]["positive"]["temperature_k"]
    q[RPM] = pump["speed_rpm"]
    q[RADIUS], q[ROD] = pump["crank_radius_mm"] * 1e-3, pump["rod_length_mm"] * 1e-3
    q[DELTA], q[HEAD] = pump["effective_length_mm"] * 1e-3, pump["head_area_cm2"] * 1e-4
    q[T_PIS] = pump["gas_temperature_k"]
    q[C_IN], q[C_OUT] = pump["inlet_check_area_mm2"] * 1e-6, pump["outlet_check_area_mm2"] * 1e-6
    for valve, u, p, k, a in ((vp, CU_P, CP_P, CK_P, AN_P), (vn, CU_N, CP_N, CK_N, AN_N)):
        q[u], q[k] = valve["input_area_mm2"] * 1e-6, valve["spring_area_mm2"] * 1e-6
        q[p] = valve["pressure_area_mm2_per_n"] * 1e-6
        q[a] = nozzle(valve) * 1e3  # N per kPa
    return q


@numba.njit(cache=True)
def phi(p):
    """Outflow function of eq. (3) for the ratio of pressures p = P_down/P_up."""
    if p >= 1.0:
        return 0.0
    if p <= 0.5282817877171742:
        return 0.684731456401159
    y = p ** (1.0 / 7.0)
    y5 = y * y * y * y * y
    return 2.6457513110645907 * y5 * math.sqrt(1.0 - y * y)


@numba.njit(cache=True)
def orifice(area, p_up, p_down, t_up):
    """R times the mass flow, kPa m^3 / K / s; one way only. The 1e3 under the root: P in kPa on both sides cancels."""
    return area * p_up * math.sqrt(R_GAS / t_up) * phi(p_down / p_up)


@numba.njit(cache=True)
def vents(q, u_pos, u_neg, p_pos, p_neg):
    """Flows out of the positive and into the negative chamber, eqs. (4) and (5)."""
    a = max(q[CU_P] * u_pos + q[CP_P] * q[AN_P] * (p_pos - q[ATM]) - q[CK_P], 0.0)
    b = max(q[CU_N] * u_neg + q[CP_N] * q[AN_N] * (q[ATM] - p_neg) - q[CK_N], 0.0)
    return orifice(a, p_pos, q[ATM], q[T_CH]), orifice(b, q[ATM], p_neg, q[T_ATM])


@numba.njit(cache=True)
def piston(q, theta, p, p_pos, p_neg):
    """Rate of a piston's pressure, and what it draws and delivers."""
    s, c = math.sin(theta), math.cos(theta)
    r, l = q[RADIUS], q[ROD]
    root = math.sqrt(l * l - r * r * s * s)
    v = q[HEAD] * (q[DELTA] - r + l - r * c - root)
    dv = q[HEAD] * q[RPM] * (2.0 * math.pi / 60.0) * (r * s + r * r * s * c / root)
    drawn = orifice(q[C_IN], p_neg, p, q[T_CH])
    given = orifice(q[C_OUT], p, p_pos, q[T_PIS])
    return (-p * dv + (drawn - given) * q[T_PIS]) / v, drawn, given


@numba.njit(cache=True)
def rates(q, theta, x, u_pos, u_neg, r_pos, r_neg, out):
    d1, in1, out1 = piston(q, theta, x[0], x[2], x[3])
    d2, in2, out2 = piston(q, theta + math.pi, x[1], x[2], x[3])
    vp, vn = vents(q, u_pos, u_neg, x[2], x[3])
    out[0], out[1] = d1, d2
    out[2] = q[T_CH] / q[V_POS] * (out1 + out2 - vp) + r_pos
    out[3] = q[T_CH] / q[V_NEG] * (vn - in1 - in2) + r_neg


@numba.njit(cache=True)
def tick_resolved(q, x, u_pos, u_neg, r_pos, r_neg, steps):
    """One revolution, 20 ms, of RK4; x is changed in place."""
    h = TICK_S / steps
    w = q[RPM] * (2.0 * math.pi / 60.0)
    k1, k2, k3, k4, y = np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for n in range(steps):
        th = w * h * n
        rates(q, th, x, u_pos, u_neg, r_pos, r_neg, k1)
        for i in range(4):
            y[i] = x[i] + 0.5 * h * k1[i]
        rates(q, th + 0.5 * w * h, y, u_pos, u_neg, r_pos, r_neg, k2)
        for i in range(4):
            y[i] = x[i] + 0.5 * h * k2[i]
        rates(q, th + 0.5 * w * h, y, u_pos, u_neg, r_pos, r_neg, k3)
        for i in range(4):
            y[i] = x[i] + h * k3[i]
        rates(q, th + w * h, y, u_pos, u_neg, r_pos, r_neg, k4)
        for i in range(4):
            x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@numba.njit(cache=True)
def pump_cell(q, p_pos, p_neg, steps, turns):
    """Pistons between chambers that hold their mean and breathe with the pump: mean flows, and how far the reading at
    the start of a revolution lies from the mean. Returns drawn, given, offset positive, offset negative, pistons."""
    h = TICK_S / steps
    w = q[RPM] * (2.0 * math.pi / 60.0)
    x = np.array([p_neg, p_pos])
    rip_p, rip_n = np.zeros(steps + 1), np.zeros(steps + 1)
    new_p, new_n = np.zeros(steps + 1), np.zeros(steps + 1)
    gin = np.zeros(steps + 1)
    gout = np.zeros(steps + 1)
    for _ in range(turns):
        gin[0] = 0.0
        gout[0] = 0.0
        for n in range(steps):
            fin, fout = 0.0, 0.0
            mp, mn = 0.5 * (rip_p[n] + rip_p[n + 1]), 0.5 * (rip_n[n] + rip_n[n + 1])
            for i in range(2):
                th = w * h * n + math.pi * i
                a1, i1, o1 = piston(q, th, x[i], p_pos + rip_p[n], p_neg + rip_n[n])
                a2, i2, o2 = piston(q, th + 0.5 * w * h, x[i] + 0.5 * h * a1, p_pos + mp, p_neg + mn)
                a3, i3, o3 = piston(q, th + 0.5 * w * h, x[i] + 0.5 * h * a2, p_pos + mp, p_neg + mn)
                a4, i4, o4 = piston(q, th + w * h, x[i] + h * a3, p_pos + rip_p[n + 1], p_neg + rip_n[n + 1])
                x[i] += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                fin += (i1 + 2.0 * i2 + 2.0 * i3 + i4) / 6.0
                fout += (o1 + 2.0 * o2 + 2.0 * o3 + o4) / 6.0
            gin[n + 1] = gin[n] + h * fin
            gout[n + 1] = gout[n] + h * fout
        for n in range(steps + 1):
            new_p[n] = q[T_CH] / q[V_POS] * (gout[n] - gout[steps] * n / steps)
            new_n[n] = -q[T_CH] / q[V_NEG] * (gin[n] - gin[steps] * n / steps)
        mean_p, mean_n = np.mean(new_p[:-1]), np.mean(new_n[:-1])
        for n in range(steps + 1):
            rip_p[n], rip_n[n] = new_p[n] - mean_p, new_n[n] - mean_n
    return gin[steps] / TICK_S, gout[steps] / TICK_S, rip_p[0], rip_n[0], x[0], x[1]


@numba.njit(cache=True)
def pump_table(q, pos, neg, steps, turns):
    table = np.empty((len(pos), len(neg), 4))
    for i in range(len(pos)):
        for j in range(len(neg)):
            a, b, c, d, _, _ = pump_cell(q, pos[i], neg[j], steps, turns)
            table[i, j, 0], table[i, j, 1], table[i, j, 2], table[i, j, 3] = a, b, c, d
    return table


@numba.njit(cache=True)
def lagrange4(t, w):
    """Cubic through four points at -1, 0, 1, 2."""
    w[0] = -t * (t - 1.0) * (t - 2.0) / 6.0
    w[1] = (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    w[2] = -(t + 1.0) * t * (t - 2.0) / 2.0
    w[3] = (t + 1.0) * t * (t - 1.0) / 6.0


@numba.njit(cache=True)
def look_up(table, axes, p_pos, p_neg, first, count, out):
    """`count` entries from `first`, cubic in both pressures, held at the edges; axes are lowest and step of each."""
    n, m = table.shape[0], table.shape[1]
    a = min(max((p_pos - axes[0]) / axes[1], 1.0), n - 2.000001)
    b = min(max((p_neg - axes[2]) / axes[3], 1.0), m - 2.000001)
    i, j = int(a), int(b)
    wa, wb = np.empty(4), np.empty(4)
    lagrange4(a - i, wa)
    lagrange4(b - j, wb)
    for c in range(count):
        s = 0.0
        for k in range(4):
            for l in range(4):
                s += wa[k] * wb[l] * table[i - 1 + k, j - 1 + l, first + c]
        out[c] = s


@numba.njit(cache=True)
def mean_rates(q, table, axes, p_pos, p_neg, u_pos, u_neg, flow):
    look_up(table, axes, p_pos, p_neg, 0, 2, flow)
    vp, vn = vents(q, u_pos, u_neg, p_pos, p_neg)
    return q[T_CH] / q[V_POS] * (flow[1] - vp), q[T_CH] / q[V_NEG] * (vn - flow[0])


@numba.njit(cache=True)
def tick_averaged(q, table, axes, p_pos, p_neg, u_pos, u_neg, r_pos, r_neg):
    """20 ms of mean pressures by two steps of RK4."""
    f = np.empty(2)
    h = TICK_S / 2.0
    for _ in range(2):
        a1, b1 = mean_rates(q, table, axes, p_pos, p_neg, u_pos, u_neg, f)
        a1, b1 = a1 + r_pos, b1 + r_neg
        a2, b2 = mean_rates(q, table, axes, p_pos + 0.5 * h * a1, p_neg + 0.5 * h * b1, u_pos, u_neg, f)
        a2, b2 = a2 + r_pos, b2 + r_neg
        a3, b3 = mean_rates(q, table, axes, p_pos + 0.5 * h * a2, p_neg + 0.5 * h * b2, u_pos, u_neg, f)
        a3, b3 = a3 + r_pos, b3 + r_neg
        a4, b4 = mean_rates(q, table, axes, p_pos + h * a3, p_neg + h * b3, u_pos, u_neg, f)
        a4, b4 = a4 + r_pos, b4 + r_neg
        p_pos += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        p_neg += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    return p_pos, p_neg


@numba.njit(cache=True)
def one_step_averaged(q, table, axes, p, u):
    """Where the averaged plant is one tick after each reading p (kPa gauge), less that reading, in kPa/s."""
    n = len(p)
    r = np.zeros((n, 2))
    off = np.empty(2)
    for k in range(n):
        a, b = p[k, 0] + q[ATM], p[k, 1] + q[ATM]
        look_up(table, axes, a, b, 2, 2, off)
        x, y = tick_averaged(q, table, axes, a - off[0], b - off[1], u[k, 0], u[k, 1], 0.0, 0.0)
        r[k, 0], r[k, 1] = (x + off[0] - a) / TICK_S, (y + off[1] - b) / TICK_S
    return r


@numba.njit(cache=True)
def one_step_resolved(q, p, u, steps):
    """The same with the crank turned; the chambers are set to each reading, the pistons go on as they are."""
    n = len(p)
    r = np.zeros((n, 2))
    _, _, _, _, one, two = pump_cell(q, p[0, 0] + q[ATM], p[0, 1] + q[ATM], 200, 40)
    x = np.array([one, two, 0.0, 0.0])
    for k in range(n):
        x[2], x[3] = p[k, 0] + q[ATM], p[k, 1] + q[ATM]
        tick_resolved(q, x, u[k, 0], u[k, 1], 0.0, 0.0, steps)
        r[k, 0] = (x[2] - q[ATM] - p[k, 0]) / TICK_S
        r[k, 1] = (x[3] - q[ATM] - p[k, 1]) / TICK_S
    return r


class Averaged:
    """The plant with the pump's mean flows in a table."""

    def __init__(self, q):
        self.q = q
        pos, neg = np.linspace(q[ATM] + 5.0, q[ATM] + 185.0, 19), np.linspace(max(q[ATM] - 97.0, 2.0), q[ATM] - 25.0, 19)
        self.axes = np.array([pos[0], pos[1] - pos[0], neg[0], neg[1] - neg[0]])
        self.table = pump_table(q, pos, neg, 200, 40)

    def one_step(self, p, u):
        """Targets and correction for a recording p [n, 2] (kPa gauge), u [n, 2], both [n - 1, 2] in kPa/s: what each
        tick moved beyond the resolved plant, and what the resolved plant moves beyond this one. The second holds the
        gas in the cylinders, which means over a revolution forget; it is added in free runs near the recording."""
        fine = one_step_resolved(self.q, p[:-1], u[:-1], 200)
        coarse = one_step_averaged(self.q, self.table, self.axes, p[:-1], u[:-1])
        return np.diff(p, axis=0) / TICK_S - fine, fine - coarse

    def start(self, p):
        """Mean pressures for a reading."""
        off = np.empty(2)
        look_up(self.table, self.axes, p[0] + self.q[ATM], p[1] + self.q[ATM], 2, 2, off)
        return p[0] + self.q[ATM] - off[0], p[1] + self.q[ATM] - off[1]

    def free_run(self, first, u, residual=None, correction=None):
        """Readings [n, 2], kPa gauge, under commands u from the first reading; residual(k, readings) in kPa/s.
        `correction` [n, 2] is the second series of `one_step`."""
        q, off = self.q, np.empty(2)
        a, b = self.start(first)
        out = np.empty((len(u), 2))
        r = (0.0, 0.0)
        for k in range(len(u)):
            look_up(self.table, self.axes, a, b, 2, 2, off)
            out[k, 0], out[k, 1] = a + off[0] - q[ATM], b + off[1] - q[ATM]
            if residual is not None:
                r = residual(k, out[k])
            c = (0.0, 0.0) if correction is None or k >= len(correction) else correction[k]
            a, b = tick_averaged(q, self.table, self.axes, a, b, u[k, 0], u[k, 1], r[0] + c[0], r[1] + c[1])
            if not (1.0 < a < 500.0 and 1.0 < b < 500.0):
                out[k:] = np.nan
                break
        return out


def run_resolved(q, first, u, residual=None, steps=200):
    """The same with the crank turned; pistons start as they do between chambers at rest at the first reading."""
    a, b = first[0] + q[ATM], first[1] + q[ATM]
    _, _, off_p, off_n, one, two = pump_cell(q, a, b, 200, 40)
    _, _, _, _, one, two = pump_cell(q, a - off_p, b - off_n, 200, 40)
    x = np.array([one, two, a, b])
    out = np.empty((len(u), 2))
    r = (0.0, 0.0)
    for k in range(len(u)):
        out[k] = x[2] - q[ATM], x[3] - q[ATM]
        if residual is not None:
            r = residual(k, out[k])
        tick_resolved(q, x, u[k, 0], u[k, 1], r[0], r[1], steps)
        if not (np.all(np.isfinite(x)) and np.all(x > 0.5) and np.all(x < 2000.0)):
            out[k:] = np.nan
            break
    return out
