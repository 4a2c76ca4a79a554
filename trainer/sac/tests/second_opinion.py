"""SAC with CAPS by torch's autograd and Adam in double precision: `second_opinion.py INPUT OUTPUT`.

INPUT and OUTPUT are rows of f64; what lies where is said by src/tests/torch.rs, which writes and reads them."""
import sys

import numpy as np
import torch

torch.set_default_dtype(torch.float64)
torch.set_num_threads(1)
data = np.fromfile(sys.argv[1])
at = 0


def take(*size):
    global at
    count = int(np.prod(size))
    at += count
    return torch.tensor(data[at - count:at]).reshape(size)


observations, goal_start, goal_end, actions, width1, width2, batch, updates = take(8).int().tolist()
rate, discount, tau, lambda_t, lambda_s, target_entropy, log_std_low, log_std_high, log_alpha = take(9).tolist()
features = int(take(1).item())
spec = take(features, 4)
sigma = take(observations)


def featurise(x):
    plus = x[:, spec[:, 0].long()]
    minus = torch.where(spec[:, 1] >= 0, x[:, spec[:, 1].clamp(min=0).long()], 0.0)
    return (plus - minus - spec[:, 2]) * spec[:, 3]


def network(inputs, outputs):
    layers = []
    for i, o in ((inputs, width1), (width1, width2), (width2, outputs)):
        linear = torch.nn.Linear(i, o)
        linear.weight.data, linear.bias.data = take(o, i), take(o)
        layers += [linear, torch.nn.ReLU()]
    return torch.nn.Sequential(*layers[:-1])


def copy(net):
    import copy as module
    return module.deepcopy(net)


actor = network(features, 2 * actions)
critics = [network(actions + features, 1) for _ in range(2)]
slow = [copy(critic) for critic in critics]
log_alpha = torch.tensor([log_alpha], requires_grad=True)
both = [p for critic in critics for p in critic.parameters()]
optimisers = {"actor": torch.optim.Adam(actor.parameters(), lr=rate), "critics": torch.optim.Adam(both, lr=rate),
              "alpha": torch.optim.Adam([log_alpha], lr=rate)}


def descend(name, loss):
    optimisers[name].zero_grad()
    loss.backward()
    optimisers[name].step()


def sample(x, noise):
    mean, log_std = actor(x).chunk(2, 1)
    gauss = torch.distributions.Normal(mean, log_std.clamp(log_std_low, log_std_high).exp())
    u = mean + gauss.stddev * noise
    squash = torch.distributions.transforms.TanhTransform()
    density = gauss.log_prob(u) - squash.log_abs_det_jacobian(u, u.tanh())
    return u.tanh(), density.sum(1)


def value(critic, action, x):
    return critic(torch.cat([action, x], 1))[:, 0]


def mean_action(x):
    return actor(featurise(x))[:, :actions].tanh()


def distance(a, b):
    return ((a - b).square().sum(1) + 1e-8).sqrt().mean()


rows = take(updates, batch, 3 * observations + 3 * actions + 2)
for row in rows:
    o, following, action, tail, eps, eps_next, noise = row.split(
        [observations, observations, actions, 2, actions, actions, observations], 1)
    reward, live = tail[:, 0], tail[:, 1]
    x, x_next, alpha = featurise(o), featurise(following), log_alpha.exp().item()
    with torch.no_grad():
        next_action, next_density = sample(x_next, eps_next)
        future = torch.min(*(value(critic, next_action, x_next) for critic in slow)) - alpha * next_density
        target = reward + live * discount * future
    descend("critics", sum(torch.nn.functional.mse_loss(value(critic, action, x), target) for critic in critics))
    with torch.no_grad():
        for critic, follower in zip(critics, slow):
            for p, q in zip(critic.parameters(), follower.parameters()):
                q.lerp_(p, tau)
    drawn, density = sample(x, eps)
    held = following.clone()
    held[:, goal_start:goal_end] = o[:, goal_start:goal_end]
    mu = mean_action(o)
    caps = lambda_t * distance(mu, mean_action(held)) + lambda_s * distance(mu, mean_action(o + sigma * noise))
    descend("actor", (alpha * density - torch.min(*(value(critic, drawn, x) for critic in critics))).mean() + caps)
    descend("alpha", -(log_alpha.exp() * (density.detach() + target_entropy)).mean())


def moment(name, key):
    states = optimisers[name].state
    return [states[p][key] for group in optimisers[name].param_groups for p in group["params"]]


out = []
for name, parameters in (("actor", list(actor.parameters())), ("critics", both)):
    out += parameters + moment(name, "exp_avg") + moment(name, "exp_avg_sq")
out += [p for critic in slow for p in critic.parameters()]
out += [log_alpha] + moment("alpha", "exp_avg") + moment("alpha", "exp_avg_sq")
np.concatenate([p.detach().numpy().ravel() for p in out]).tofile(sys.argv[2])
