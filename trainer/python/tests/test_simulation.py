"""Simulation against closed forms and against `trainer simulate`. Run: python3 -m pytest trainer/python/tests

The programs are looked for in TRAINER and CONTROLLER, then in target/release, then on the PATH; without them what
compares with them is skipped.
"""

import subprocess
import unittest
import warnings

import numpy as np

import dual_pressure
from programs import ROOT, folder, program, table

EXAMPLES = ROOT / "docs/examples/first_diagnosis"


def refusal(call, *arguments, **settings):
    """The line of the ValueError that a call raises."""
    try:
        call(*arguments, **settings)
    except ValueError as refused:
        assert "\n" not in str(refused), refused
        return str(refused)
    raise AssertionError(f"{call.__name__}{arguments} is not refused")


def simulated_by_trainer(rig, inputs, *options):
    """Columns of the file that `trainer simulate` writes."""
    trainer = program("trainer")
    with folder() as here:
        out = here / "simulated.csv"
        command = [trainer, "simulate", "--rig", rig, "--inputs", inputs, "--out", out, *options]
        subprocess.run([str(part) for part in command], check=True, capture_output=True)
        return table(out)


def as_written(kpa):
    """Pressures with the seven digits of the file, halves away from zero."""
    return np.copysign(np.floor(np.abs(kpa) * 1e7 + 0.5) / 1e7, kpa) + 0.0


class ClosedForms(unittest.TestCase):
    def test_open_vents_keep_a_rig_at_rest_near_the_atmosphere(self):
        # The pump stands: nothing moves air, so both pressures stay where they are to rounding.
        p_pos, p_neg = dual_pressure.simulate("dual_pressure", np.ones(50), np.ones(50), pump_on=np.zeros(50, bool))
        self.assertEqual(p_pos.shape, (50,))
        self.assertLess(max(np.abs(p_pos).max(), np.abs(p_neg).max()), 1e-6)

    def test_settles_where_the_plants_own_numbers_say(self):
        # Settled pressures of the paper's rig at 0.8/0.8, from an independent implementation (0.1 kPa is its rounding).
        duties = np.full(1500, 0.8)
        p_pos, p_neg = dual_pressure.simulate("dual_pressure", duties, duties, start_kpa=(90, -70))
        self.assertLess(abs(p_pos[-50:].mean() - 95.0), 0.2)
        self.assertLess(abs(p_neg[-50:].mean() + 71.4), 0.2)


class AsTheProgram(unittest.TestCase):
    """Equal to `trainer simulate` to the last digit that it writes."""

    def assert_equal_to_trainer(self, rig, inputs, *options, refine=dual_pressure.REFINE):
        with self.subTest(rig=str(rig), inputs=inputs.name, options=options), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = simulated_by_trainer(rig, inputs, *options)
            found = dual_pressure.simulate_recording(rig, dual_pressure.read_recording(inputs, rig), refine)
            self.assertTrue(found)
            for column, kpa in found.items():
                np.testing.assert_array_equal(as_written(kpa), expected[column], column)

    def test_under_a_recording(self):
        # With play, friction, lag, delay and warm gas (bench), and without; coarsely and finely.
        self.assert_equal_to_trainer("bench", EXAMPLES / "holds.csv")
        self.assert_equal_to_trainer("dual_pressure", EXAMPLES / "closed_loop.csv")
        self.assert_equal_to_trainer("bench", EXAMPLES / "closed_loop.csv", "--refine", "1", refine=1)

    def test_from_rest_with_the_pump_off_for_a_while_and_behind_a_gap(self):
        generator = np.random.default_rng(5)
        u_pos, u_neg = np.repeat(generator.uniform(0.5, 1.0, (2, 12)), 25, axis=1)
        pump = np.arange(300) % 100 < 80
        with folder() as here:
            commands = here / "commands.csv"
            rows = zip(range(300), u_pos.tolist(), u_neg.tolist(), pump)
            lines = ["time_s,u_pos,u_neg,pump_on"] + [f"{0.02 * k:.2f},{a!r},{b!r},{on:d}" for k, a, b, on in rows]
            commands.write_text("\n".join(lines) + "\n")
            expected = simulated_by_trainer("bench", commands)
            p_pos, p_neg = dual_pressure.simulate("bench", u_pos, u_neg, pump)
            np.testing.assert_array_equal(as_written(p_pos), expected["p_pos_kpa"])
            np.testing.assert_array_equal(as_written(p_neg), expected["p_neg_kpa"])
            # Rows 100 to 149 are lost: the run begins anew at the pressures of row 150.
            lines = (EXAMPLES / "holds.csv").read_text().splitlines()[:400]
            gap = here / "gap.csv"
            gap.write_text("\n".join(lines[:101] + lines[151:]) + "\n")
            self.assert_equal_to_trainer("bench", gap)

    def test_for_a_rig_of_another_kind_and_a_logger_of_its_own(self):
        rig = ROOT / "docs/rigs/softbot_pump.toml"
        with folder() as here:
            log = here / "sweep.csv"
            lines = ["Time;Target;Pressure;PWM"]
            lines += [f"{0.02 * k:.2f};20;{0.3 * k:.1f};{min(255, 4 * k)}".replace(".", ",") for k in range(80)]
            log.write_text("\n".join(lines) + "\n")
            self.assert_equal_to_trainer(rig, log)


class Refusals(unittest.TestCase):
    def test_say_in_one_line_what_is_wrong(self):
        simulate, two = dual_pressure.simulate, [0.5, 0.5]
        nan = float("nan")
        for words, arguments, settings in [
            ("built in are dual_pressure, bench", ("nowhere.toml", two, two), {}),
            ("u_pos[1] is 1.5; commands are within 0", ("bench", [0.5, 1.5], two), {}),
            ("u_neg[0] is NaN", ("bench", two, [nan, 0.5]), {}),
            ("u_pos has 2 duties and u_neg 1", ("bench", two, [0.5]), {}),
            ("u_pos must be a row of numbers", ("bench", [two], two), {}),
            ("u_pos must be a row of numbers", ("bench", ["open"], two), {}),
            ("no rows", ("bench", [], []), {}),
            ("pump_on has 1 ticks and u_pos 2", ("bench", two, two), {"pump_on": [True]}),
            ("pump_on is True or False", ("bench", two, two), {"pump_on": [1, 2]}),
            ("start_kpa is (positive, negative)", ("bench", two, two), {"start_kpa": 90.0}),
            ("the sign seems to be lost", ("bench", two, two), {"start_kpa": (90.0, 70.0)}),
            ("refine is a whole number within 1", ("bench", two, two), {"refine": 0}),
            ("no column u_pump; rig softbot_pump takes", (ROOT / "docs/rigs/softbot_pump.toml", two, two), {}),
        ]:
            with self.subTest(words):
                self.assertIn(words, refusal(simulate, *arguments, **settings))

    def test_of_columns_name_the_column_and_what_the_rig_takes(self):
        simulate, two = dual_pressure.simulate_recording, [0.5, 0.5]
        line = refusal(simulate, "bench", {"time_s": [0.0, 0.02], "u_pos": two, "note": ["a", "b"]})
        self.assertRegex(line, "no column u_neg; rig bench takes time_s, .*u_neg.*given: time_s, u_pos")
        line = refusal(simulate, "bench", {"time_s": [0.0, 0.02], "u_pos": two, "u_neg": [0.5]})
        self.assertEqual(line, "u_neg has 1 numbers, time_s has 2")
        self.assertIn("20 ms", refusal(simulate, "bench", {"time_s": [0.0, 0.01], "u_pos": two, "u_neg": two}))

    def test_columns_that_nobody_asks_for_may_hold_anything(self):
        asked = {"time_s": [0.0, 0.02], "u_pos": [0.5, 0.5], "u_neg": [0.5, 0.5]}
        others = {"note": ["a", "b"], "spare": [float("nan"), 7.0]}
        found, expected = (dual_pressure.simulate_recording("bench", columns) for columns in (asked | others, asked))
        np.testing.assert_array_equal(found["p_pos_kpa"], expected["p_pos_kpa"])


if __name__ == "__main__":
    unittest.main()
