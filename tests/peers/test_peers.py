"""Checks that need no recordings: python test_peers.py"""

import math
import warnings

import numpy as np

import plant
import residuals

warnings.simplefilter("ignore")


def nominal():
    """The paper's rig, packed; numbers of Table III."""
    q = np.zeros(21)
    q[plant.ATM], q[plant.T_ATM], q[plant.V_POS], q[plant.V_NEG], q[plant.T_CH] = 101.325, 293.15, 0.75e-3, 0.4e-3, 293.15
    q[plant.RPM], q[plant.RADIUS], q[plant.ROD], q[plant.DELTA], q[plant.HEAD] = 3000.0, 0.02, 0.07, 0.041, 38.485e-4
    q[plant.T_PIS], q[plant.C_IN], q[plant.C_OUT] = 323.15, 33.47e-6, 1.46e-6
    q[plant.CU_P], q[plant.CP_P], q[plant.CK_P] = 4.876e-6, 3.066e-6, 4.474e-6
    q[plant.CU_N], q[plant.CP_N], q[plant.CK_N] = 7.992e-6, 7.590e-6, 7.339e-6
    q[plant.AN_P] = q[plant.AN_N] = math.pi * 0.003**2 / 4 * 1e3
    return q


def choked_flow_has_the_textbook_value():
    # 0.0404 kg/s per m^2, Pa and K^-1/2: air through a choked nozzle.
    flow = plant.orifice(1e-6, 500.0, 101.0, 293.15) / plant.R_GAS * 1e3  # kg/s; kPa to Pa
    assert abs(flow - 0.0404 * 1e-6 * 500e3 / math.sqrt(293.15)) < 2e-3 * flow


def settled_pressures_are_those_of_the_paper_s_rig():
    # Another implementation of the same equations settles at 74.7/-81.2 kPa with duties of 0.8 and 0.6.
    run = plant.run_resolved(nominal(), (75.0, -81.0), np.tile([0.8, 0.6], (600, 1)))
    assert np.allclose(run[-1], [74.7, -81.2], atol=0.06), run[-1]


def the_averaged_plant_follows_the_resolved_one():
    # Steps of both commands; what cylinders hold is forgotten by means over a revolution, hence 0.3 kPa.
    q, u = nominal(), np.tile([0.8, 0.7], (500, 1))
    u[150:300] = [0.7, 0.8]
    fine = plant.run_resolved(q, (85.2, -76.3), u)
    averaged = plant.Averaged(q)
    coarse = averaged.free_run((85.2, -76.3), u)
    assert np.sqrt(np.mean((fine - coarse) ** 2)) < 0.3
    _, correction = averaged.one_step(fine, u)
    mended = averaged.free_run((85.2, -76.3), u, correction=correction)
    assert np.sqrt(np.mean((fine - mended) ** 2)) < 0.03


class Known:
    """Rows of four inputs with targets x0^2 and x1 - 0.5 x0 x3, and noise."""

    def __init__(self):
        rng = np.random.default_rng(3)
        self.kind, x = "static", rng.uniform(-1, 1, size=(2000, 4))
        self.y = np.column_stack([x[:, 0] ** 2, x[:, 1] - 0.5 * x[:, 0] * x[:, 3]])
        self.x, rows = x, np.ones(2000, bool)
        self.runs = [(x, self.y + 0.05 * rng.normal(size=(2000, 2)), rows)]

    def stacked(self):
        return self.runs[0][0], self.runs[0][1]


def each_peer_learns_functions_that_are_known():
    known = Known()
    # Noise of 0.05 in 2000 rows: what has few terms comes out much below it, the others near it.
    for fitted, most in ((residuals.sindy(known, 2, 0.1, 1e-3, 1), 0.01), (residuals.symbolic(known, 0.001, 600, 12, 1), 0.25),
                         (residuals.gaussian_process(known, 300, 200, 1), 0.05), (residuals.network(known, 24, 1e-3, 1), 0.1)):
        learnt = np.array([fitted.of(row) for row in known.x[:300]])
        error = np.sqrt(np.mean((learnt - known.y[:300]) ** 2))
        assert error < most, (fitted.told, error)


def sindy_says_what_it_found():
    first, second = residuals.sindy(Known(), 2, 0.1, 1e-3, 1).formula
    assert first.endswith("p_pos^2") and len(first.split()) == 2, first
    assert "p_neg" in second and "p_pos u_neg" in second, second


if __name__ == "__main__":
    for check in (choked_flow_has_the_textbook_value, settled_pressures_are_those_of_the_paper_s_rig,
                  the_averaged_plant_follows_the_resolved_one, each_peer_learns_functions_that_are_known,
                  sindy_says_what_it_found):
        check()
        print(f"{check.__name__}: holds")
