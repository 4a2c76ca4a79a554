"""The environment by Gymnasium's own checker, and trained by Stable-Baselines3 where that is installed."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

import dual_pressure  # noqa: E402


def make(**settings):
    return dual_pressure.DualPressureEnv(rig="bench", model="dual_pressure", episode_s=2.0, **settings)


def test_passes_gymnasiums_own_checker():
    from gymnasium.utils.env_checker import check_env

    check_env(make(), skip_render_check=True)


def test_a_seed_is_an_episode_and_another_seed_another():
    def flown(seed):
        env = make(spread=10.0)
        observation, _ = env.reset(seed=seed)
        rewards = [env.step(np.full(12, 0.85, np.float32))[1] for _ in range(20)]
        return observation.tolist(), rewards

    assert flown(3) == flown(3)
    assert flown(3) != flown(4)


def test_predictions_are_what_comes_where_the_model_is_the_plant():
    env = dual_pressure.DualPressureEnv(rig="dual_pressure", episode_s=4.0, noise_v_rms=0.0)
    env.reset(seed=1)

    def plan(tick):
        # Duties of this tick and the next five, positive and negative side by side: what is then done.
        ahead = 0.3 * (tick + np.arange(6))
        return np.stack([0.8 + 0.08 * np.sin(ahead), 0.85 + 0.08 * np.cos(ahead)], axis=1).astype(np.float32).ravel()

    seen = [env.step(plan(tick))[0] for tick in range(80)]
    # Numbers 22..31 are predictions for the next five ticks, 20 and 21 the reading now. What no plan contains is the
    # integral's way over five ticks, and half a step of the converter (0.04 kPa) on either side.
    pairs = list(zip(seen[20:], seen[25:]))
    predicted = max(np.abs(now[30:32] - later[20:22]).max() for now, later in pairs)
    unchanged = max(np.abs(now[20:22] - later[20:22]).max() for now, later in pairs)
    assert predicted < 0.3 and predicted < 0.2 * unchanged, (predicted, unchanged)


def test_an_episode_ends_as_a_truncation_and_leaving_the_envelope_as_a_terminal_state():
    env = make()
    env.reset(seed=5)
    ends = [env.step(np.full(12, 0.85, np.float32))[2:4] for _ in range(100)]
    assert ends[-1] == (False, True) and not any(terminal or cut for terminal, cut in ends[:-1])
    env = dual_pressure.DualPressureEnv(rig="bench", episode_s=20.0)
    env.reset(seed=5)
    assert any(env.step(np.zeros(12, np.float32))[2] for _ in range(1000)), "shut valves must leave the envelope"


def test_stable_baselines3_learns_on_it():
    sb3 = pytest.importorskip("stable_baselines3")
    import torch

    torch.set_num_threads(1)
    model = sb3.SAC("MlpPolicy", make(), learning_starts=100, device="cpu", seed=0)
    model.learn(300)
    action, _ = model.predict(model.env.reset(), deterministic=True)
    assert action.shape == (1, 12) and np.isfinite(action).all()
