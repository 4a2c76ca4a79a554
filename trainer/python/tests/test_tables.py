"""Simulation and recordings against closed forms and files written here. Run: python3 -m pytest trainer/python/tests"""

import numpy as np
import pytest

import dual_pressure


def test_open_vents_keep_a_rig_at_rest_near_the_atmosphere():
    # The pump stands: nothing moves air, so both pressures stay where they are to rounding.
    p_pos, p_neg = dual_pressure.simulate("dual_pressure", np.ones(50), np.ones(50), pump_on=np.zeros(50, bool))
    assert p_pos.shape == (50,) and np.abs(p_pos).max() < 1e-6 and np.abs(p_neg).max() < 1e-6


def test_settles_where_the_plants_own_numbers_say():
    # Settled pressures of the paper's rig at 0.8/0.8, from an independent implementation (0.1 kPa is its rounding).
    p_pos, p_neg = dual_pressure.simulate("dual_pressure", np.full(1500, 0.8), np.full(1500, 0.8), start_kpa=(90, -70))
    assert abs(p_pos[-50:].mean() - 95.0) < 0.2 and abs(p_neg[-50:].mean() + 71.4) < 0.2


def test_refusals_are_one_line():
    for arguments in [("nowhere.toml", [0.5], [0.5]), ("bench", [1.5], [0.5])]:
        with pytest.raises(ValueError) as refused:
            dual_pressure.simulate(*arguments)
        assert "\n" not in str(refused.value)
    with pytest.raises(ValueError, match="alike"):
        dual_pressure.simulate("bench", [0.5], [0.5, 0.6])


def test_reads_a_recording_by_column(tmp_path):
    rows = ["time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa"]
    rows += [f"{0.02 * k:.2f},0.8,0.7,{80 + k},{-70 - k}" for k in range(100)]
    file = tmp_path / "run.csv"
    file.write_text("\n".join(rows) + "\n")
    run = dual_pressure.read_recording(file)
    assert run["time_s"][-1] == pytest.approx(1.98) and run["p_pos_kpa"].tolist() == [80.0 + k for k in range(100)]
    with pytest.raises(ValueError, match="no_such"):
        dual_pressure.read_recording(tmp_path / "no_such.csv")
