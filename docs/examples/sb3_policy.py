"""A Stable-Baselines3 policy that the controller runs: observation layout v1, trained on the real plant, exported as ONNX.

    pip install stable-baselines3 onnx onnxruntime dist/dual_pressure-*.whl     # the wheel: trainer/python/README.md
    python3 sb3_policy.py --steps 20000 --out my_policy.onnx
    controller check-policy my_policy.onnx
    controller demo --policy my_policy.onnx

`--rig` takes a built-in rig or a rig file; `--rig toy` is two first-order lags and needs no wheel, enough to show what a
policy reads and answers. What the controller asks for is all in `observation`, `Scaled`, `Answer` and `export`.
docs/policies.md has the tables.
"""

import argparse
import warnings

import gymnasium
import numpy as np
import onnx
import stable_baselines3
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

RATE_HZ = 50
PAST, AHEAD, GOALS_AHEAD = 10, 5, 15
# Observation layout v1, in order: (quantity, first tick, last tick), each tick as positive and negative side.
INPUTS = [("p", -PAST, AHEAD), ("ref", -PAST, GOALS_AHEAD)]
OUTPUTS = [("u", 0, AHEAD)]
# What the rig can produce, positive and negative side (kPa gauge).
LOWEST, HIGHEST = np.array([0.0, -95.0]), np.array([160.0, 0.0])


def names(groups):
    return [f"{q}_{side}[{j}]" for q, first, last in groups for j in range(first, last + 1) for side in ("pos", "neg")]


def observation(measured, predicted, goals):
    """84 numbers in kPa gauge: pressures of ticks -10..0, predictions 1..5, references -10..15."""
    return np.concatenate([measured, predicted, goals]).astype(np.float32).ravel()


class ToyRig(gymnasium.Env):
    """Each chamber drifts to what its duty allows: full vacuum or pressure at 0, the open air at 1."""

    LIMIT = np.array([150.0, -92.0])
    KEPT = np.exp(-1 / RATE_HZ / 0.3)
    TICKS = 250

    def __init__(self):
        wide = [np.tile(bound, PAST + 1 + AHEAD + PAST + 1 + GOALS_AHEAD) for bound in (LOWEST, HIGHEST)]
        self.observation_space = gymnasium.spaces.Box(*(b.astype(np.float32) for b in wide))
        self.action_space = gymnasium.spaces.Box(0.0, 1.0, (2 * (AHEAD + 1),), np.float32)

    def after(self, pressure, duty):
        return self.KEPT * pressure + (1 - self.KEPT) * (1 - duty) * self.LIMIT

    def observe(self):
        predicted, pressure = [], self.measured[-1]
        for duty in self.plan:
            pressure = self.after(pressure, duty)
            predicted.append(pressure)
        return observation(self.measured, predicted, self.goals[self.tick : self.tick + PAST + 1 + GOALS_AHEAD])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        draw = self.np_random.uniform
        t = np.arange(self.TICKS + PAST + 1 + GOALS_AHEAD)[:, None] / RATE_HZ
        wave = np.sin(2 * np.pi * draw(0.1, 0.4, 2) * t + draw(0, 6, 2))
        self.goals = (0.5 + draw(-0.2, 0.2, 2) + draw(0.05, 0.2, 2) * wave) * self.LIMIT
        self.measured = np.tile(self.goals[0] + draw(-5, 5, 2), (PAST + 1, 1))
        # What was planned, one tick ago, for now and the next four ticks.
        self.plan = np.tile(1 - self.measured[-1] / self.LIMIT, (AHEAD, 1))
        self.tick = 0
        return self.observe(), {}

    def step(self, action):
        duties = np.clip(action, 0, 1).reshape(AHEAD + 1, 2)
        pressure = self.after(self.measured[-1], duties[0])
        self.measured = np.vstack([self.measured[1:], pressure])
        self.plan = duties[1:]
        self.tick += 1
        error_kpa = np.abs(pressure - self.goals[self.tick + PAST])
        # A time limit is no end: `truncated`, never `terminated`.
        return self.observe(), -error_kpa.sum() / 20, False, self.tick == self.TICKS, {"error_kpa": error_kpa}


class Scaled(BaseFeaturesExtractor):
    """kPa gauge to -1..1, inside the network: the file takes what the sensors say."""

    def __init__(self, space):
        super().__init__(space, space.shape[0])
        low, high = torch.as_tensor(space.low), torch.as_tensor(space.high)
        self.register_buffer("middle", (low + high) / 2)
        self.register_buffer("half_range", (high - low) / 2)

    def forward(self, observed):
        return (observed - self.middle) / self.half_range


class Answer(torch.nn.Module):
    """The actor's mean action as duties: what `SAC.predict(..., deterministic=True)` answers."""

    def __init__(self, actor):
        super().__init__()
        self.scaled, self.hidden, self.mean = actor.features_extractor, actor.latent_pi, actor.mu

    def forward(self, observed):
        return 0.5 * torch.tanh(self.mean(self.hidden(self.scaled(observed)))) + 0.5


def environment(rig):
    """The toy, or a plant whose model knows the paper's rig only, as on a bench."""
    if rig == "toy":
        return ToyRig()
    import dual_pressure

    return dual_pressure.DualPressureEnv(rig=rig, model="dual_pressure", episode_s=10.0)


def error_kpa(info):
    if "error_kpa" in info:
        return info["error_kpa"]
    return np.abs([info["p_pos_kpa"] - info["ref_pos_kpa"], info["p_neg_kpa"] - info["ref_neg_kpa"]])


def track(model, env, episodes=4):
    """Observations of whole episodes and the mean error (kPa) over them."""
    seen, errors = [], []
    for episode in range(episodes):
        (observed, _), ended = env.reset(seed=1000 + episode), False
        while not ended:
            seen.append(observed)
            observed, _, terminated, truncated, info = env.step(model.predict(observed, deterministic=True)[0])
            errors.append(error_kpa(info))
            ended = terminated or truncated
    return np.array(seen), np.mean(errors, axis=0)


def export(model, seen, out, said):
    """Writes the actor with its metadata; `seen` are observations that golden pairs are taken from."""
    answer = Answer(model.policy.actor).eval()
    row = torch.zeros(1, seen.shape[1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        # dynamo=True needs the package onnxscript and external_data=False; the controller takes its files as well.
        torch.onnx.export(answer, (row,), out, input_names=["observation"], output_names=["action"],
                          dynamic_axes={"observation": {0: "batch"}, "action": {0: "batch"}},
                          opset_version=17, dynamo=False)  # fmt: skip
    golden = seen[:: max(1, len(seen) // 8)][:8]
    answers = model.predict(golden, deterministic=True)[0]
    # Nine significant digits read back to the same float32.
    rows = lambda values: ";".join(",".join(f"{x:.9g}" for x in row) for row in values)
    metadata = {
        "contract": "1",
        "rate_hz": str(RATE_HZ),
        "input_unit": "kPa gauge",
        "output_unit": "duty",
        "input_names": ",".join(names(INPUTS)),
        "output_names": ",".join(names(OUTPUTS)),
        "golden_input": rows(golden),
        "golden_output": rows(answers),
    }
    graph = onnx.load(out)
    onnx.helper.set_model_props(graph, metadata | said)
    onnx.checker.check_model(graph, full_check=True)
    onnx.save(graph, out)
    return golden, answers


def compare(out, seen, model):
    """Largest difference between the file in onnxruntime and the policy in torch."""
    try:
        import onnxruntime
    except ImportError:
        return "onnxruntime is not here, the file was not run"
    session = onnxruntime.InferenceSession(out, providers=["CPUExecutionProvider"])
    (answers,) = session.run(None, {"observation": seen})
    worst = np.abs(answers - model.predict(seen, deterministic=True)[0]).max()
    if not worst < 1e-5:
        raise SystemExit(f"{out}: onnxruntime and torch differ by {worst:.1e}; do not fly this file")
    return f"onnxruntime and torch agree within {worst:.1e} on {len(seen)} observations"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--steps", type=int, default=20_000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--rig", default="bench", help="plant: bench, dual_pressure, a rig file, or toy")
    arguments.add_argument("--out", default="sb3_policy.onnx")
    arguments = arguments.parse_args()
    # Networks of this size gain nothing from a second thread, and lose much where cores are shared.
    torch.set_num_threads(1)
    env = environment(arguments.rig)
    model = SAC("MlpPolicy", env, seed=arguments.seed, batch_size=128, gamma=0.9, device="cpu",
                policy_kwargs={"features_extractor_class": Scaled, "net_arch": [256, 256]})  # fmt: skip
    _, before_kpa = track(model, env)
    model.learn(arguments.steps)
    seen, after_kpa = track(model, env)
    said = {"rig": arguments.rig, "seed": str(arguments.seed), "steps": str(arguments.steps), "variant": "sac"}
    said["trainer"] = f"stable-baselines3 {stable_baselines3.__version__}"
    export(model, seen, arguments.out, said)
    print(f"{arguments.out}: written; {compare(arguments.out, seen, model)}")
    line = "mean error on {}, positive/negative: untrained {:.1f}/{:.1f} kPa, trained {:.1f}/{:.1f} kPa"
    print(line.format(arguments.rig, *before_kpa, *after_kpa))


if __name__ == "__main__":
    main()
