"""A Stable-Baselines3 policy that the controller runs: observation layout v1, trained on the real plant, exported as ONNX.

    pip install stable-baselines3 onnx onnxruntime dist/dual_pressure-*.whl     # the wheel: trainer/python/README.md
    python3 sb3_policy.py --steps 20000 --out my_policy.onnx
    controller check-policy my_policy.onnx
    controller demo --policy my_policy.onnx

Residual learning: `Base` is the model turned round, fitted to a simulation; SAC then learns a small correction of its
answer on a plant that the model does not know all of. `Answer` puts both into one chain of layers, which is the file.

`--rig` takes a built-in rig or a rig file; `--rig toy` is two first-order lags and needs no wheel, enough to show what a
policy reads and answers. docs/policies.md has the tables.
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
INPUTS_WIDTH = 84
# What the base knows of the plant.
MODEL = "dual_pressure"
# How fast the base makes up for an error, 1/s, and the share of what the model did not foresee that it takes off.
CATCH_UP, OBSERVED = 4.0, 0.4
# Most that is learned on top of the base's answer, in duty: less than what would spoil it on rigs other than the plant.
CORRECTION = 0.02
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

    @classmethod
    def after(cls, pressure, duty):
        return cls.KEPT * pressure + (1 - cls.KEPT) * (1 - duty) * cls.LIMIT

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


def split(observed):
    """Pressures and goals of rows of observations: (row, tick from -10 on, side), kPa gauge."""
    return observed[:, :32].unflatten(1, (-1, 2)), observed[:, 32:].unflatten(1, (-1, 2))


def layer(function):
    """The layer that computes a function of sums of observed numbers."""
    bias = function(torch.zeros(1, INPUTS_WIDTH))[0]
    linear = torch.nn.Linear(INPUTS_WIDTH, len(bias)).requires_grad_(False)
    linear.weight.data, linear.bias.data = (function(torch.eye(INPUTS_WIDTH)) - bias).T.contiguous(), bias
    return linear


def aims(observed):
    """For each tick of the plan the place (the goals) and the slopes to take, kPa and kPa/s: (row, 6 x 4).

    A slope is the goal's, and more while the pressure is behind. Predictions know the duties in force. A pressure that has
    risen faster than they let expect needs that much less, which makes the base hold on plants that the model is not.
    """
    p, goals = split(observed)
    now, end = PAST, PAST + AHEAD
    ahead_of_goals = p - goals[:, : end + 1]
    seen = (ahead_of_goals[:, now] - ahead_of_goals[:, 0]) * RATE_HZ / PAST
    foreseen = (ahead_of_goals[:, end] - ahead_of_goals[:, now]) * RATE_HZ / AHEAD
    feedback = -CATCH_UP * ahead_of_goals[:, now] - OBSERVED * (seen - foreseen)
    slopes = (goals[:, now + 3 : end + 4] - goals[:, now - 1 : end]) * RATE_HZ / 4 + feedback[:, None]
    return torch.cat([goals[:, now : end + 1], slopes], 2).flatten(1)


def errors(observed):
    """What a correction depends on, each about 1: errors, also predicted ones, the goals' ways, and the place."""
    p, goals = split(observed)
    now = goals[:, PAST : PAST + 1]
    return torch.cat([goals[:, : PAST + 1 + AHEAD] - p, goals - now, 0.03 * now], 1).flatten(1)


def transitions(rig, seed, spans=8000, span=5):
    """What duties do to the pressures of the model: (pressures, slopes) and the duties, held for `span` ticks each."""
    draw = np.random.default_rng(seed).uniform
    lowest = 0.0 if rig == "toy" else 0.6  # below, the valves of the paper's rig are shut
    # Rests here and jumps there: a place for every forty spans, and how far the duties go from it.
    place, jump = np.repeat(draw(lowest, 1, (spans // 40, 2)), 40, axis=0), draw(0, 1, (spans, 1)) ** 3
    duties = np.repeat(place + jump * (draw(lowest, 1, (spans, 2)) - place), span, axis=0)
    if rig == "toy":
        pressures = np.zeros_like(duties)
        for tick in range(1, len(duties)):
            pressures[tick] = ToyRig.after(pressures[tick - 1], duties[tick - 1])
    else:
        import dual_pressure

        pressures = np.stack(dual_pressure.simulate(MODEL, *duties.T, refine=1), axis=1)
    # Without the way up from rest.
    pressures, duties = pressures[40 * span :: span], duties[40 * span :: span]
    middle, slope = (pressures[1:] + pressures[:-1]) / 2, (pressures[1:] - pressures[:-1]) / (span / RATE_HZ)
    return np.hstack([middle, slope]).astype(np.float32), duties[:-1].astype(np.float32)


class Base(torch.nn.Module):
    """The model turned round: the duties under which pressures at a place take a slope, for the six ticks of a plan."""

    def __init__(self, rig, seed, rounds=8000):
        super().__init__()
        went, duties = map(torch.as_tensor, transitions(rig, seed))
        torch.manual_seed(seed)
        hidden = [torch.nn.Linear(4, 32), torch.nn.Tanh(), torch.nn.Linear(32, 32), torch.nn.Tanh()]
        self.inverse = torch.nn.Sequential(*hidden, torch.nn.Linear(32, 2), torch.nn.Tanh())
        self.aims = layer(aims)
        middle, spread = went.mean(0), went.std(0)
        optimizer = torch.optim.Adam(self.inverse.parameters(), 1e-2)
        slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, rounds)
        for _ in range(rounds):
            batch = torch.randint(len(went), (256,))
            answers = 0.5 * self.inverse((went[batch] - middle) / spread) + 0.5
            optimizer.zero_grad()
            torch.nn.functional.mse_loss(answers, duties[batch]).backward()
            optimizer.step()
            slower.step()
        # The scaling becomes part of the first layer: the file takes what the sensors say.
        self.aims.weight /= spread.repeat(AHEAD + 1)[:, None]
        self.aims.bias -= (middle / spread).repeat(AHEAD + 1)

    @torch.no_grad()
    def forward(self, observed):
        aimed = self.aims(torch.as_tensor(observed)).unflatten(-1, (AHEAD + 1, 4))
        return (0.5 * self.inverse(aimed) + 0.5).flatten(-2).numpy()


class Corrected(gymnasium.Wrapper):
    """The rig with the base in control; an action is a correction of both duties, -1 to 1 of CORRECTION."""

    def __init__(self, env, base):
        super().__init__(env)
        self.base, self.action_space = base, gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def duties(self, observed, action):
        return np.clip(self.base(observed) + CORRECTION * np.tile(action, AHEAD + 1), 0.0, 1.0).astype(np.float32)

    def reset(self, **chosen):
        self.observed, info = self.env.reset(**chosen)
        return self.observed, info

    def step(self, action):
        self.observed, *rest = self.env.step(self.duties(self.observed, action))
        return self.observed, *rest


class Errors(BaseFeaturesExtractor):
    """`errors` as the network's first layer: the file takes what the sensors say."""

    def __init__(self, space):
        linear = layer(errors)
        super().__init__(space, linear.out_features)
        self.linear = linear

    def forward(self, observed):
        return self.linear(observed)


def beside(*layers):
    """Layers side by side, each on values of its own, as one layer."""
    joined = torch.nn.Linear(sum(x.in_features for x in layers), sum(x.out_features for x in layers))
    joined.weight.data = torch.block_diag(*(x.weight.data for x in layers))
    joined.bias.data = torch.cat([x.bias.data for x in layers])
    return joined


class Answer(torch.nn.Module):
    """Base and the actor's mean action as the one chain of layers that the controller takes."""

    def __init__(self, base, actor):
        super().__init__()
        first = torch.nn.Linear(INPUTS_WIDTH, base.aims.out_features + actor.features_extractor.features_dim)
        aimed, seen = base.aims, actor.features_extractor.linear
        first.weight.data = torch.cat([aimed.weight, seen.weight])
        first.bias.data = torch.cat([aimed.bias, seen.bias])
        corrections = [*actor.latent_pi, actor.mu, torch.nn.Tanh()]
        pairs = zip(base.inverse, corrections, strict=True)
        chain = [x if isinstance(x, torch.nn.Tanh) else beside(*[x] * (AHEAD + 1), y) for x, y in pairs]
        # Duties from the base's -1 ... 1, and the correction of each side on every tick's.
        last = torch.nn.Linear(2 * (AHEAD + 1) + 2, 2 * (AHEAD + 1))
        last.weight.data = torch.hstack([0.5 * torch.eye(2 * (AHEAD + 1)), CORRECTION * torch.eye(2).repeat(AHEAD + 1, 1)])
        last.bias.data.fill_(0.5)
        self.chain = torch.nn.Sequential(first, *chain, last)

    def forward(self, observed):
        return self.chain(observed).clamp(0.0, 1.0)


def environment(rig):
    """The toy, or a plant whose model knows the paper's rig only, as on a bench."""
    if rig == "toy":
        return ToyRig()
    import dual_pressure

    return dual_pressure.DualPressureEnv(rig=rig, model=MODEL, episode_s=10.0)


def error_kpa(info):
    if "error_kpa" in info:
        return info["error_kpa"]
    return np.abs([info["p_pos_kpa"] - info["ref_pos_kpa"], info["p_neg_kpa"] - info["ref_neg_kpa"]])


def track(answer, env, episodes=4):
    """Observations of whole episodes and the mean error (kPa) over them."""
    seen, errors = [], []
    for episode in range(episodes):
        (observed, _), ended = env.reset(seed=1000 + episode), False
        while not ended:
            seen.append(observed)
            observed, _, terminated, truncated, info = env.step(answer(observed))
            errors.append(error_kpa(info))
            ended = terminated or truncated
    return np.array(seen), np.mean(errors, axis=0)


def export(base, model, answer, seen, out, said):
    """Writes the actor with its metadata; `seen` are observations that golden pairs are taken from."""
    chain = Answer(base, model.policy.actor).eval()
    row = torch.zeros(1, seen.shape[1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        # dynamo=True needs the package onnxscript and external_data=False; the controller takes its files as well.
        torch.onnx.export(chain, (row,), out, input_names=["observation"], output_names=["action"],
                          dynamic_axes={"observation": {0: "batch"}, "action": {0: "batch"}},
                          opset_version=17, dynamo=False)  # fmt: skip
    golden = seen[:: max(1, len(seen) // 8)][:8]
    answers = answer(golden)
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


def compare(out, seen, answer):
    """Largest difference between the file in onnxruntime and the policy in torch."""
    try:
        import onnxruntime
    except ImportError:
        return "onnxruntime is not here, the file was not run"
    session = onnxruntime.InferenceSession(out, providers=["CPUExecutionProvider"])
    (answers,) = session.run(None, {"observation": seen})
    worst = np.abs(answers - answer(seen)).max()
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
    base = Base(arguments.rig, arguments.seed)
    env = Corrected(environment(arguments.rig), base)
    # `Answer` needs tanh and two hidden layers here, as the base has.
    network = {"features_extractor_class": Errors, "net_arch": [64, 64], "activation_fn": torch.nn.Tanh}
    model = SAC("MlpPolicy", env, seed=arguments.seed, learning_rate=lambda left: 1e-3 * left, gamma=0.95, train_freq=2,
                ent_coef="auto_0.01", device="cpu", policy_kwargs=network)  # fmt: skip
    answer = lambda observed: env.duties(observed, model.predict(observed, deterministic=True)[0])
    _, before_kpa = track(base, env.env)
    model.learn(arguments.steps)
    seen, after_kpa = track(answer, env.env)
    said = {"rig": arguments.rig, "seed": str(arguments.seed), "steps": str(arguments.steps), "variant": "sac"}
    said["trainer"] = f"stable-baselines3 {stable_baselines3.__version__}"
    export(base, model, answer, seen, arguments.out, said)
    print(f"{arguments.out}: written; {compare(arguments.out, seen, answer)}")
    line = "mean error on {}, positive/negative: base {:.2f}/{:.2f} kPa, corrected {:.2f}/{:.2f} kPa"
    print(line.format(arguments.rig, *before_kpa, *after_kpa))


if __name__ == "__main__":
    main()
