"""The environment by Gymnasium's own checker, against the paper's reward, and trained by Stable-Baselines3 where that is.

Run: python3 -m pytest trainer/python/tests
"""

import importlib.util
import json
import subprocess
import sys
import unittest
import warnings

import numpy as np

import dual_pressure
from programs import ROOT, folder, program

try:
    import gymnasium
    from gymnasium.utils.env_checker import check_env
except ImportError as missing:
    raise unittest.SkipTest("no Gymnasium here (pip install gymnasium)") from missing
try:
    import stable_baselines3
    import torch
except ImportError:
    stable_baselines3 = None

OPEN = np.full(12, 0.85, np.float32)


def make(**settings):
    settings = {"rig": "bench", "model": "dual_pressure", "episode_s": 2.0} | settings
    return dual_pressure.DualPressureEnv(**settings)


def refusal(call, *arguments, **settings):
    """The line of the ValueError that a call raises."""
    try:
        call(*arguments, **settings)
    except ValueError as refused:
        assert "\n" not in str(refused), refused
        return str(refused)
    raise AssertionError(f"{arguments} {settings} is not refused")


class Interface(unittest.TestCase):
    def test_passes_gymnasiums_own_checker_without_a_warning(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # The checker says so of every environment that is not made by gymnasium.make.
            warnings.filterwarnings("ignore", message=".*not initialized using `gymnasium.make`.*|.*render.*|.*spec.*")
            check_env(make(), skip_render_check=True)

    def test_spaces_are_those_of_the_layout_and_hold_what_comes(self):
        env = make()
        self.assertEqual((env.observation_space.shape, env.action_space.shape), ((84,), (12,)))
        self.assertEqual((env.action_space.low.min(), env.action_space.high.max()), (0.0, 1.0))
        env.action_space.seed(2)
        observation, info = env.reset(seed=2)
        for _ in range(100):
            self.assertTrue(env.observation_space.contains(observation))
            self.assertEqual(set(info), {"p_pos_kpa", "p_neg_kpa", "ref_pos_kpa", "ref_neg_kpa", "u_pos", "u_neg"})
            observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
            self.assertEqual([type(x) for x in (reward, terminated, truncated)], [float, bool, bool])

    def test_a_seed_is_an_episode_and_without_one_another_follows(self):
        def flown(env, **seed):
            observation, _ = env.reset(**seed)
            return observation.tolist(), [env.step(OPEN)[1] for _ in range(20)]

        one, other = make(spread=10.0), make(spread=10.0)
        first = flown(one, seed=3)
        self.assertEqual(first, flown(other, seed=3))
        # The series of episodes that a seed begins is the seed's as well.
        self.assertNotEqual(first, second := flown(one))
        self.assertEqual(second, flown(other))
        self.assertEqual(first, flown(one, seed=3))
        self.assertNotEqual(first, flown(one, seed=4))

    def test_refusals_are_one_line_under_the_names_of_arguments(self):
        for words, settings in [
            ("no_such: there is neither a file nor a built-in rig", {"rig": "no_such"}),
            ("no_such: there is neither a file nor a built-in rig", {"model": "no_such"}),
            ("spread: 80 is not within 0 … 50 %", {"spread": 80.0}),
            ("episode_s: 0 is not within", {"episode_s": 0.0}),
            ("noise_v_rms: -1 is not within", {"noise_v_rms": -1.0}),
        ]:
            self.assertIn(words, refusal(make, **settings))
        env = make()
        self.assertIn("call reset() before step()", refusal(env.step, OPEN))
        env.reset(seed=0)
        nan = OPEN.copy()
        nan[3] = np.nan
        self.assertEqual(refusal(env.step, nan), "action[3] is nan; a duty must be a number; beyond 0 and 1 it is taken as 0 or 1")
        self.assertIn("12 duties", refusal(env.step, OPEN[:2]))
        # Beyond the range a duty is taken at its end.
        pressures = []
        for far in (1.0, 9.0):
            env.reset(seed=3)
            pressures.append(env.step(np.full(12, far, np.float32))[4]["p_pos_kpa"])
        self.assertEqual(pressures[0], pressures[1])
        self.assertIn("12 duties", refusal(env.step, OPEN.reshape(6, 2)))


    def test_a_rig_whose_sensors_leave_the_wires_volts_is_refused_as_plant_and_as_model(self):
        # The daemon takes 0.8 … 5.2 V for sound: a policy learned on such a rig could not be flown.
        text = (ROOT / "model/rigs/bench.toml").read_text()
        self.assertEqual(text.count("range_v = [1.0, 5.0]"), 2)
        with folder() as here:
            rig = here / "volts.toml"
            rig.write_text(text.replace("range_v = [1.0, 5.0]", "range_v = [0.0, 10.0]", 1))
            for settings in ({"rig": str(rig)}, {"model": str(rig)}):
                told = refusal(make, **settings)
                self.assertRegex(told, r"volts\.toml: sensors\.\w+\.range_v: .* 0 kPa at 0 V; .* 0\.8 … 5\.2 V")


class Physics(unittest.TestCase):
    def test_predictions_are_what_comes_where_the_model_is_the_plant(self):
        env = make(rig="dual_pressure", model=None, episode_s=4.0, noise_v_rms=0.0)
        env.reset(seed=1)

        def plan(tick):
            # Duties of this tick and the next five, positive and negative side by side: what is then done.
            ahead = 0.3 * (tick + np.arange(6))
            return np.stack([0.8 + 0.08 * np.sin(ahead), 0.85 + 0.08 * np.cos(ahead)], axis=1).ravel()

        seen = [env.step(plan(tick))[0] for tick in range(80)]
        # Numbers 22..31 are predictions for the next five ticks, 20 and 21 the reading now. What no plan contains is the
        # integral's way over five ticks, and half a step of the converter (0.04 kPa) on either side.
        pairs = list(zip(seen[20:], seen[25:]))
        predicted = max(np.abs(now[30:32] - later[20:22]).max() for now, later in pairs)
        unchanged = max(np.abs(now[20:22] - later[20:22]).max() for now, later in pairs)
        self.assertLess(predicted, min(0.3, 0.2 * unchanged))

    def test_rewards_are_the_papers(self):
        # Table IV: 0.3 per kPa now, 0.01 for each of the next four ticks, 0.25 for the fifth; from the observation alone.
        env = make()
        env.reset(seed=6)
        weights = np.repeat([0.3, 0.01, 0.01, 0.01, 0.01, 0.25], 2)
        for tick in range(60):
            observation, reward, *_ = env.step(np.full(12, 0.75 + 0.002 * tick))
            now_and_ahead, goals = observation[20:32], observation[32 + 20 : 32 + 32]
            self.assertAlmostEqual(reward, -(weights * np.abs(goals - now_and_ahead)).sum(), delta=1e-3)

    def test_the_past_moves_up_and_readings_are_those_of_info_but_for_noise(self):
        env = make(noise_v_rms=0.0)
        before, _ = env.reset(seed=7)
        for _ in range(30):
            after, *_, info = env.step(OPEN)
            np.testing.assert_array_equal(after[:20], before[2:22])
            readings = [info["p_pos_kpa"], info["p_neg_kpa"]]
            # A step of the converter is 0.08 kPa.
            np.testing.assert_allclose(after[20:22], readings, atol=0.08)
            np.testing.assert_allclose(after[52:54], [info["ref_pos_kpa"], info["ref_neg_kpa"]], rtol=1e-6)
            before = after

    def test_time_is_a_truncation_and_leaving_the_envelope_a_terminal_state(self):
        env = make()
        env.reset(seed=5)
        ends = [env.step(OPEN)[2:4] for _ in range(100)]
        self.assertEqual(ends[-1], (False, True))
        self.assertFalse(any(terminated or truncated for terminated, truncated in ends[:-1]))
        env = make(episode_s=20.0)
        env.reset(seed=5)
        for _ in range(1000):
            _, reward, terminated, truncated, info = env.step(np.zeros(12))
            if terminated:
                break
        # Shut valves lead out; what that costs is said, and it is no matter of time.
        self.assertTrue(terminated and not truncated)
        self.assertEqual(reward, -300.0)
        self.assertTrue(info["p_pos_kpa"] > 160.0 or info["p_neg_kpa"] < -95.0)


@unittest.skipIf(stable_baselines3 is None, "no Stable-Baselines3 here (pip install stable-baselines3)")
class StableBaselines3(unittest.TestCase):
    def test_sac_runs_on_it_and_answers(self):
        torch.set_num_threads(1)
        model = stable_baselines3.SAC("MlpPolicy", make(), learning_starts=100, device="cpu", seed=0)
        before = [parameter.detach().clone() for parameter in model.actor.parameters()]
        model.learn(300)
        moved = [(now.detach() - then).abs().max().item() for now, then in zip(model.actor.parameters(), before)]
        self.assertGreater(max(moved), 1e-4)
        observation = model.env.reset()
        action, _ = model.predict(observation, deterministic=True)
        self.assertEqual(action.shape, (1, 12))
        self.assertTrue(np.isfinite(action).all() and (0 <= action).all() and (action <= 1).all())

    @unittest.skipUnless(all(map(importlib.util.find_spec, ("onnx", "onnxruntime"))), "no onnx and onnxruntime here")
    def test_the_example_trains_on_the_plant_exports_and_flies(self):
        controller, script = program("controller"), ROOT / "docs/examples/sb3_policy.py"
        with folder() as here:
            file = here / "tiny.onnx"
            command = [sys.executable, str(script), "--steps", "150", "--out", str(file)]
            said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            self.assertRegex(said, r"onnxruntime and torch agree within \S+ on \d+ observations\nmean error on bench")
            # The base passes the trial by itself, and 150 steps of a bounded correction must not spoil that.
            command = [controller, "check-policy", str(file), "--json"]
            checked = subprocess.run(command, capture_output=True, text=True)
            self.assertEqual((checked.returncode, json.loads(checked.stdout)["sound"]), (0, True), checked.stdout)
            command = [controller, "demo", "--fast", "--seconds", "2", "--policy", str(file), "--out", str(here / "flown")]
            flown = subprocess.run(command, capture_output=True, text=True)
            self.assertIn(flown.returncode, (0, 1), flown.stderr)
            self.assertIn("in control: tiny", flown.stdout)


if __name__ == "__main__":
    unittest.main()
