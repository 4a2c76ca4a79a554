"""The rig as a Gymnasium environment: what a policy reads and answers on the running daemon, tick by tick."""

import numpy as np

try:
    import gymnasium
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError("DualPressureEnv needs Gymnasium: pip install gymnasium", name="gymnasium") from missing

from . import _native, _rig_name

DUTIES = 12


class DualPressureEnv(gymnasium.Env):
    """Observation layout v1 (docs/policies.md): 84 numbers in kPa gauge in, 12 duties out, the paper's reward.

    rig           plant: a built-in name ("dual_pressure", "bench") or a rig file
    model         what MPObs (model-predicted observations) use; left out, the plant's own rig file
    episode_s     length of an episode in s, 1 to 600; its end is a truncation, leaving 160/-95 kPa a terminal state
    noise_v_rms   noise of the converter in V RMS, 0 to 0.1; left out, that of the emulated cRIO
    spread        domain randomisation: every episode draws volumes, valves and check valves within +- so many percent

    Each episode draws a reference over the reachable range; it follows from the seed of reset(). An action holds
    u_pos and u_neg of this tick, then of the next five, which the prediction takes; duties beyond 0 and 1 are taken
    as 0 and 1, and NaN is refused. The applied duty is sat(action + integral), as in the daemon. Info: pressures
    without noise, the reference, and the applied duties.
    """

    metadata = {"render_modes": []}

    def __init__(self, rig="dual_pressure", model=None, episode_s=20.0, noise_v_rms=None, spread=0.0):
        super().__init__()
        model = None if model is None else _rig_name(model)
        noise_v_rms = None if noise_v_rms is None else float(noise_v_rms)
        self._native = _native.Env(_rig_name(rig), model, float(episode_s), noise_v_rms, float(spread))
        low, high = (np.frombuffer(b, dtype="<f4").copy() for b in self._native.bounds())
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(0.0, 1.0, (DUTIES,), np.float32)

    def _observation(self, bytes_):
        # Readings beyond the sensors' physical range (noise at rest, a way out of the envelope) are shown at its end.
        return np.clip(np.frombuffer(bytes_, dtype="<f4"), self.observation_space.low, self.observation_space.high)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        episode = int(self.np_random.integers(2**63))
        observation, info = self._native.reset(episode)
        return self._observation(observation), dict(info)

    def step(self, action):
        duties = np.asarray(action, dtype=np.float32)
        if duties.shape != (DUTIES,):
            raise ValueError(f"an action is {DUTIES} duties, u_pos and u_neg of six ticks; this one has shape {duties.shape}")
        if not np.isfinite(duties).all():
            place = int(np.flatnonzero(~np.isfinite(duties))[0])
            mend = "a duty must be a number; beyond 0 and 1 it is taken as 0 or 1"
            raise ValueError(f"action[{place}] is {duties[place]}; {mend}")
        duties = np.clip(duties, 0.0, 1.0).tolist()
        observation, reward, terminated, truncated, info = self._native.step(duties)
        return self._observation(observation), reward, terminated, truncated, dict(info)
