#!/usr/bin/env python3
"""Writes this folder's golden traces: the paper's rig by an implementation that shares nothing with the crate.

    python3 make.py            writes steps.csv, ramps.csv, relay.csv, slip.csv beside this file
    python3 make.py --refine   also integrates each trace with a hundredth of the tolerance and prints what changes

Python's standard library only. Equations (1)-(7) of Park et al., RA-L 2025, as printed, with powers; numbers of
their Table III (nozzle diameter 3 mm, which the table lacks). What the crate does differently, so that an error
in one does not hide in the other:

    here                                              crate
    Dormand-Prince 5(4), step chosen by the error     classical RK4, 0.1 ms
    a step ends wherever a check valve turns          blind to check valves
    p^(2/k), p^((k+1)/k)                              polynomial in 1 - p
    sin and cos of the crank angle at each stage      rotation from half step to half step, tabled

Columns: those of a recording, and `pump_on`. Row k holds the pressures at t_k (gauge kPa, before any sensor)
and the commands that act from t_k to t_{k+1}. Rest at t = 0: atmosphere everywhere, crank at zero.
"""
import math
import pathlib
import sys

R, KAPPA = 287.0, 1.4
P_ATM = 101325.0
T_ATM = T_CH = 293.15
T_PIS = 323.15
V_POS, V_NEG = 0.75e-3, 0.4e-3
S, RADIUS, ROD, DELTA = 38.485e-4, 0.020, 0.070, 0.041
C_IN, C_OUT = 33.47e-6, 1.46e-6
NOZZLE = math.pi * 0.003**2 / 4
VENT_POS = (4.876e-6, 3.066e-6, 4.474e-6)   # area per duty, per newton, spring: m^2
VENT_NEG = (7.992e-6, 7.590e-6, 7.339e-6)
PHASES = (0.0, math.pi)
TICK = 0.02

P_CRITICAL = (2 / (KAPPA + 1)) ** (KAPPA / (KAPPA - 1))
PHI_CHOKED = math.sqrt(KAPPA * (2 / (KAPPA + 1)) ** ((KAPPA + 1) / (KAPPA - 1)))


def orifice(area, p_up, p_down, t_up):
    """Eq. (3): mass flow in kg/s, one way."""
    if p_down >= p_up or area <= 0:
        return 0.0
    p = p_down / p_up
    if p <= P_CRITICAL:
        phi = PHI_CHOKED
    else:
        phi = math.sqrt(2 * KAPPA / (KAPPA - 1) * (p ** (2 / KAPPA) - p ** ((KAPPA + 1) / KAPPA)))
    return area * p_up / math.sqrt(R * t_up) * phi


def vent_area(valve, duty, difference):
    """Eqs. (4)-(5) with the difference between the valve's ports."""
    per_duty, per_newton, spring = valve
    return max(per_duty * duty + per_newton * NOZZLE * difference - spring, 0.0)


def rates(t, x, u_pos, u_neg, omega, angle):
    """d/dt of [P_pis1, P_pis2, P_pos, P_neg] in Pa/s; `angle` is the crank's at t = 0 of the tick."""
    *pistons, p_pos, p_neg = x
    into_pos = -orifice(vent_area(VENT_POS, u_pos, p_pos - P_ATM), p_pos, P_ATM, T_CH)
    into_neg = orifice(vent_area(VENT_NEG, u_neg, P_ATM - p_neg), P_ATM, p_neg, T_ATM)
    out = []
    for p, phase in zip(pistons, PHASES):
        theta = angle + omega * t + phase
        sin, cos = math.sin(theta), math.cos(theta)
        root = math.sqrt(ROD**2 - (RADIUS * sin) ** 2)
        volume = S * (DELTA - RADIUS + ROD - RADIUS * cos - root)
        growth = S * omega * (RADIUS * sin + RADIUS**2 * sin * cos / root)
        drawn = orifice(C_IN, p_neg, p, T_CH)
        delivered = orifice(C_OUT, p, p_pos, T_PIS)
        into_neg -= drawn
        into_pos += delivered
        out.append((-p * growth + (drawn - delivered) * R * T_PIS) / volume)
    out.append(R * T_CH / V_POS * into_pos)
    out.append(R * T_CH / V_NEG * into_neg)
    return out


# Dormand & Prince (1980), the pair of order 5 and 4.
NODES = (0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1)
STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = (71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
LONGEST, SHORTEST = 1e-4, 2e-8


def regime(x):
    """Which check valves pass and which of them are choked; steps should not reach across a change."""
    *pistons, p_pos, p_neg = x
    bits = []
    for p in pistons:
        bits += [p < p_neg, p < P_CRITICAL * p_neg, p > p_pos, p_pos < P_CRITICAL * p]
    return bits


def advance(x, h, until, inputs, tolerance):
    """Integrates over one tick; returns the state at its end and the last step tried."""
    t = 0.0
    k1 = rates(t, x, *inputs)
    while until - t > 1e-15:
        last = h >= until - t
        step = until - t if last else h
        ks = [k1]
        for node, row in zip(NODES[1:], STAGES[1:]):
            y = [xi + step * sum(a * k[i] for a, k in zip(row, ks)) for i, xi in enumerate(x)]
            ks.append(rates(t + node * step, y, *inputs))
        worst = max(
            abs(step * sum(e * k[i] for e, k in zip(ERROR, ks))) / (tolerance * max(abs(x[i]), 1e3)) for i in range(4)
        )
        turned = regime(x) != regime(y)
        if step > SHORTEST and (worst > 1 or (turned and step > 1e-6)):
            h = max(step * (0.3 if turned else max(0.2, 0.9 * worst**-0.2)), SHORTEST)
            continue
        t, x, k1 = (until if last else t + step), y, ks[-1]
        h = min(max(step * min(5.0, 0.9 * max(worst, 1e-9) ** -0.2), SHORTEST), LONGEST)
    return x, h


def trace(commands, rpm, tolerance):
    """Rows of one trace; `commands` yields (u_pos, u_neg, pump_on) tick by tick."""
    x = [P_ATM] * 4
    h, angle, rows = 1e-6, 0.0, []
    for k, (u_pos, u_neg, on) in enumerate(commands):
        rows.append((k * TICK, u_pos, u_neg, on, (x[2] - P_ATM) / 1e3, (x[3] - P_ATM) / 1e3))
        omega = on * rpm / 60 * math.tau
        x, h = advance(x, min(h, 1e-6), TICK, (u_pos, u_neg, omega, angle), tolerance)
        angle = (angle + omega * TICK) % math.tau
    return rows


def steps():
    """Both shut from rest, then steps in one or both, beyond the limits of the opening on either side."""
    for u_pos, u_neg, ticks in ((0, 0, 15), (1, 1, 20), (1, 0.55, 20), (0.7, 0.8, 20), (0.25, 1, 20), (0.95, 0.3, 25)):
        for _ in range(ticks):
            yield u_pos, u_neg, 1


def ramps():
    """Triangles of unequal period, in opposite directions."""
    for k in range(120):
        triangle = lambda period: abs((k / period) % 2 - 1)
        yield round(0.4 + 0.6 * triangle(37), 6), round(0.95 - 0.4 * triangle(23), 6), 1


def relay():
    """The pump stops with pressure up, the vents let it go, the pump starts again."""
    for u_pos, u_neg, on, ticks in ((0.6, 0.6, 1, 30), (0.6, 0.6, 0, 10), (0.9, 0.9, 0, 20), (0.8, 0.7, 1, 40)):
        for _ in range(ticks):
            yield u_pos, u_neg, on


def slip():
    """Steps with the pump at 2917 rpm: the crank stands elsewhere at each tick."""
    for u_pos, u_neg, ticks in ((0.85, 0.75, 50), (0.7, 0.9, 50)):
        for _ in range(ticks):
            yield u_pos, u_neg, 1


TRACES = {"steps": (steps, 3000.0), "ramps": (ramps, 3000.0), "relay": (relay, 3000.0), "slip": (slip, 2917.0)}
TOLERANCE = 1e-8    # relative, per step


def main():
    for name, (commands, rpm) in TRACES.items():
        rows = trace(commands(), rpm, TOLERANCE)
        path = pathlib.Path(__file__).with_name(name + ".csv")
        lines = ["time_s,u_pos,u_neg,pump_on,p_pos_kpa,p_neg_kpa"]
        lines += ["%.2f,%.6f,%.6f,%d,%.6f,%.6f" % row for row in rows]
        path.write_text("\n".join(lines) + "\n")
        print(path.name, len(rows), "rows")
        if "--refine" in sys.argv:
            finer = trace(commands(), rpm, TOLERANCE / 100)
            print("  tolerance / 100 changes at most %.1e kPa" % max(abs(a - b) for r, f in zip(rows, finer) for a, b in zip(r[4:], f[4:])))


if __name__ == "__main__":
    main()
