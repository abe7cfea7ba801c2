"""PPO of Stable-Baselines3 with the gradient of its loss written out.

Most of the time of a training goes into updates, and most of that into the bookkeeping of
automatic differentiation around small matrices. The loss of PPO on a plain policy (two multilayer
perceptrons, a Gaussian whose deviation does not depend on the state) has a gradient that fits on a
page. It is computed here in the same precision over the same minibatches, and Adam's step is one
over all parameters; everything else (rollouts, buffer, advantages, schedules, logs, checkpoints) is
Stable-Baselines3's own. The two differ in the order of roundings, so that a run is statistically
the same and not the same to the bit. Policies of other kinds are updated by Stable-Baselines3
itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from drm_baselines.support.extras import needing

with needing("training", "learn"):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.distributions import DiagGaussianDistribution
    from stable_baselines3.common.policies import ActorCriticPolicy
    from stable_baselines3.common.torch_layers import FlattenExtractor, MlpExtractor
    from stable_baselines3.common.utils import explained_variance
    from stable_baselines3.common.vec_env import VecEnv
    from torch import nn

_HALF_LOG_TAU = 0.5 * math.log(2.0 * math.pi)

Tensor = torch.Tensor


class _Layers:
    """A multilayer perceptron with its gradient, in arrays that are used again and again.

    Parameters
    ----------
    modules
        Linear layers and activations in turn.
    count
        Most samples at once.
    """

    def __init__(self, modules: list[nn.Module], count: int) -> None:
        linear = [module for module in modules if isinstance(module, nn.Linear)]
        self._is_tanh = any(isinstance(module, nn.Tanh) for module in modules)
        self._weights = [layer.weight.data for layer in linear]
        self._turned = [weight.t() for weight in self._weights]
        self._biases = [layer.bias.data for layer in linear]
        self._values = [torch.empty(count, weight.shape[0]) for weight in self._weights]
        self._slopes = [torch.empty(count, weight.shape[1]) for weight in self._weights[1:]]
        self._linear = linear
        self._gradients: list[tuple[Tensor, Tensor]] = []
        self._inputs = torch.empty(0)

    def receive(self, gradients: Mapping[Tensor, Tensor]) -> None:
        """Take the arrays that gradients are written into."""
        self._gradients = [(gradients[one.weight], gradients[one.bias]) for one in self._linear]

    def __call__(self, inputs: Tensor) -> Tensor:
        """Return the outputs, shape (n, outputs); they are overwritten by the next call."""
        self._inputs = values = inputs
        count, last = len(inputs), len(self._weights) - 1
        for place, (bias, weight) in enumerate(zip(self._biases, self._turned, strict=True)):
            into = self._values[place][:count]
            torch.addmm(bias, values, weight, out=into)
            if place < last:
                values = into.tanh_() if self._is_tanh else into.relu_()
        return into

    def backward(self, above: Tensor) -> None:
        """Write the gradients of all layers for the gradient of the outputs, (n, outputs)."""
        count = len(above)
        for place in range(len(self._weights) - 1, -1, -1):
            values = self._values[place - 1][:count] if place else self._inputs
            weight_grad, bias_grad = self._gradients[place]
            torch.mm(above.t(), values, out=weight_grad)
            torch.sum(above, 0, out=bias_grad)
            if place:
                below = self._slopes[place - 1][:count]
                torch.mm(above, self._weights[place], out=below)
                if self._is_tanh:
                    torch.ops.aten.tanh_backward.grad_input(below, values, grad_input=below)
                else:
                    torch.ops.aten.threshold_backward.grad_input(below, values, 0, grad_input=below)
                above = below


def is_plain(policy: Any) -> bool:
    """Return whether a policy is one whose gradient is written out here."""
    if (
        type(policy) is not ActorCriticPolicy
        or policy.use_sde
        or policy.squash_output
        or not policy.share_features_extractor
        or type(policy.features_extractor) is not FlattenExtractor
        or type(policy.mlp_extractor) is not MlpExtractor
        or type(policy.action_dist) is not DiagGaussianDistribution
    ):
        return False
    nets = (policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net)
    for net in nets:
        kinds = [type(module) for module in net]
        if not kinds or len(kinds) % 2 or any(kind is not nn.Linear for kind in kinds[::2]):
            return False
        if set(kinds[1::2]) not in ({nn.Tanh}, {nn.ReLU}):
            return False
    own = sum(1 for net in nets for module in net if isinstance(module, nn.Linear)) + 2
    return len(list(policy.parameters())) == 2 * own + 1


class _Written:
    """A plain policy with the gradient of PPO's loss, for at most ``count`` samples at once."""

    def __init__(self, policy: Any, count: int) -> None:
        self._policy = policy
        self.actor = _Layers([*policy.mlp_extractor.policy_net, policy.action_net], count)
        self.critic = _Layers([*policy.mlp_extractor.value_net, policy.value_net], count)
        self.log_std: Tensor = policy.log_std.data
        self._log_std_grad = torch.empty(0)

    def act(self, observations: Tensor, deterministic: bool = False) -> tuple[Tensor, ...]:
        """Return actions, values and log probabilities, as the policy's ``forward`` does."""
        observations = observations.flatten(1)
        mean, values = self.actor(observations), self.critic(observations).clone()
        actions = mean.clone()
        if not deterministic:
            actions += torch.empty_like(mean).normal_() * self.log_std.exp()
        return actions, values, self._log_prob(actions - mean)

    def _log_prob(self, apart: Tensor) -> Tensor:
        scaled = apart * torch.exp(-self.log_std)
        constant = self.log_std.sum() + self.log_std.numel() * _HALF_LOG_TAU
        return (scaled * scaled).sum(1).mul_(-0.5).sub_(constant)

    def receive(self, gradients: Mapping[Tensor, Tensor]) -> None:
        """Take the arrays that gradients are written into."""
        self.actor.receive(gradients)
        self.critic.receive(gradients)
        self._log_std_grad = gradients[self._policy.log_std]

    def differentiate(
        self, batch: _Batch, model: Any, clip: float, clip_vf: float | None
    ) -> Tensor:
        """Write the gradient of the loss over a minibatch.

        Returns
        -------
        Tensor
            Policy loss, value loss, approximate divergence, share of ratios that are clipped, and
            the sum of the logarithms of the standard deviations, shape (5,).
        """
        count = len(batch.actions)
        mean, values = self.actor(batch.observations), self.critic(batch.observations).flatten()
        advantages = batch.advantages
        if model.normalize_advantage and count > 1:
            spread, middle = torch.std_mean(advantages)
            advantages = (advantages - middle).div_(spread + 1e-8)
        inverse = torch.exp(-self.log_std)
        constant = self.log_std.sum()
        scaled = (batch.actions - mean).mul_(inverse)
        squares = scaled * scaled
        log_ratio = squares.sum(1).mul_(-0.5).sub_(constant).sub_(batch.log_probs)
        log_ratio.sub_(self.log_std.numel() * _HALF_LOG_TAU)
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1.0 - clip, 1.0 + clip)
        held = clipped * advantages
        share = (ratio != clipped).float().mean()
        free = advantages.mul(ratio)
        policy_loss = torch.minimum(free, held).mean().neg_()
        # what is clipped has no gradient unless the clipped value is the better one
        slope = free.mul_(free <= held).mul_(-1.0 / count).unsqueeze_(1)
        if clip_vf is None:
            apart = values - batch.returns
            value_slope = apart * (2.0 * model.vf_coef / count)
        else:
            moved = values - batch.values
            apart = batch.values + moved.clamp(-clip_vf, clip_vf) - batch.returns
            value_slope = apart * (moved.abs() <= clip_vf) * (2.0 * model.vf_coef / count)
        value_loss = torch.dot(apart, apart).div_(count)
        divergence = (ratio - log_ratio).mean().sub_(1.0)
        self.critic.backward(value_slope.unsqueeze_(1))
        self.actor.backward(scaled.mul_(inverse).mul_(slope))
        torch.sum(squares.sub_(1.0).mul_(slope), 0, out=self._log_std_grad)
        if model.ent_coef:
            self._log_std_grad.sub_(model.ent_coef)
        return torch.stack([policy_loss, value_loss, divergence, share, constant])


class _FlatAdam:
    """Adam over parameters that lie in one array, with PyTorch's own state and arithmetic.

    The parameters become parts of one array, and so do the moments in the optimiser's state, which
    checkpoints hold as before.

    Parameters
    ----------
    optimizer
        Of a policy.
    """

    def __init__(self, optimizer: torch.optim.Adam) -> None:
        (self._group,) = optimizer.param_groups
        self._states = [optimizer.state[parameter] for parameter in self._group["params"]]
        parameters: list[nn.Parameter] = self._group["params"]
        self._values = torch.cat([parameter.data.flatten() for parameter in parameters])
        self._gradient = torch.zeros_like(self._values)
        self._mean, self._square = torch.zeros_like(self._values), torch.zeros_like(self._values)
        self._root = torch.empty_like(self._values)
        self.gradients: dict[Tensor, Tensor] = {}
        self._steps = 0
        begin = 0
        for parameter, state in zip(parameters, self._states, strict=True):
            part = slice(begin, begin + parameter.numel())
            begin = part.stop
            for name, whole in (("exp_avg", self._mean), ("exp_avg_sq", self._square)):
                view = whole[part].view_as(parameter)
                if name in state:
                    view.copy_(state[name])
                state[name] = view
            state.setdefault("step", torch.tensor(0.0))
            self._steps = int(state["step"])
            parameter.data = self._values[part].view_as(parameter)
            self.gradients[parameter] = self._gradient[part].view_as(parameter)

    @staticmethod
    def fits(optimizer: Any) -> bool:
        """Return whether an optimiser is an Adam without anything special."""
        if type(optimizer) is not torch.optim.Adam or len(optimizer.param_groups) != 1:
            return False
        group = optimizer.param_groups[0]
        special = ("amsgrad", "maximize", "capturable", "differentiable")
        return group["weight_decay"] == 0.0 and not any(group.get(name) for name in special)

    def step(self, largest: float) -> None:
        """Limit the gradient's norm as ``clip_grad_norm_`` does, and make one step."""
        gradient, group = self._gradient, self._group
        norm = torch.linalg.vector_norm(gradient)
        gradient.mul_((largest / (norm + 1e-6)).clamp_(max=1.0))
        self._steps += 1
        first, second = group["betas"]
        self._mean.lerp_(gradient, 1.0 - first)
        self._square.mul_(second).addcmul_(gradient, gradient, value=1.0 - second)
        torch.sqrt(self._square, out=self._root)
        self._root.div_(math.sqrt(1.0 - second**self._steps)).add_(group["eps"])
        rate = float(group["lr"]) / (1.0 - first**self._steps)
        self._values.addcdiv_(self._mean, self._root, value=-rate)

    def finish(self) -> None:
        """Write the number of steps into the optimiser's state."""
        for state in self._states:
            state["step"].fill_(float(self._steps))


class _Batch:
    """Samples of a rollout: all of them, or a minibatch."""

    __slots__ = ("actions", "advantages", "log_probs", "observations", "returns", "values")

    def __init__(self, *arrays: Tensor) -> None:
        (
            self.observations, self.actions, self.values, self.log_probs, self.advantages,
            self.returns,
        ) = arrays  # fmt: skip

    @classmethod
    def of(cls, buffer: RolloutBuffer) -> _Batch:
        """Return all samples of a buffer, in the order that its own minibatches are drawn in."""
        names = ("observations", "actions", "values", "log_probs", "advantages", "returns")
        if not buffer.generator_ready:
            for name in names:
                setattr(buffer, name, buffer.swap_and_flatten(getattr(buffer, name)))
            buffer.generator_ready = True
        arrays = [torch.from_numpy(getattr(buffer, name)) for name in names]
        return cls(arrays[0].flatten(1), arrays[1], *(array.flatten() for array in arrays[2:]))

    def minibatches(self, order: Any, size: int) -> Iterator[_Batch]:
        """Yield minibatches of so many samples in an order; the last may be smaller."""
        places = torch.from_numpy(order)
        whole = [getattr(self, name) for name in (
            "observations", "actions", "values", "log_probs", "advantages", "returns",
        )]  # fmt: skip
        mixed = [array.index_select(0, places) for array in whole]
        for first in range(0, len(order), size):
            yield _Batch(*(array[first : first + size] for array in mixed))


class FastPPO(PPO):
    """PPO whose updates are written out; see the module."""

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        rollout_buffer: RolloutBuffer,
        n_rollout_steps: int,
    ) -> bool:
        """Fill the buffer; actions, values and probabilities without the policy's detours."""
        if not is_plain(self.policy):
            return super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        policy: Any = self.policy
        policy.forward = _Written(policy, env.num_envs).act
        try:
            return super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        finally:
            del policy.forward

    def train(self) -> None:
        """Update the policy with the rollout in the buffer."""
        if (
            not is_plain(self.policy)
            or not _FlatAdam.fits(self.policy.optimizer)
            or self.device.type != "cpu"
        ):
            super().train()
            return
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        remaining = self._current_progress_remaining
        # as in the library's own train(): after its set-up these are schedules, and the
        # optimizer is the Adam asked for above, which their declared types do not say
        clip: float = self.clip_range(remaining)  # type: ignore[operator]
        clip_vf: float | None = None
        if self.clip_range_vf is not None:
            clip_vf = self.clip_range_vf(remaining)  # type: ignore[operator]
        whole = _Batch.of(self.rollout_buffer)
        size = min(self.batch_size or len(whole.actions), len(whole.actions))
        adam = _FlatAdam(self.policy.optimizer)  # type: ignore[arg-type]
        written = _Written(self.policy, size)
        written.receive(adam.gradients)
        told: list[Tensor] = []
        going, last = True, 0
        with torch.inference_mode():
            for _ in range(self.n_epochs):
                last = len(told)
                order = np.random.permutation(len(whole.actions))  # noqa: NPY002
                for batch in whole.minibatches(order, size):
                    told.append(written.differentiate(batch, self, clip, clip_vf))
                    if self.target_kl is not None and float(told[-1][2]) > 1.5 * self.target_kl:
                        going = False
                        break
                    adam.step(self.max_grad_norm)
                self._n_updates += 1
                if not going:
                    break
        adam.finish()
        self._log_update(torch.stack(told).numpy(), last, clip, clip_vf)

    def _log_update(self, told: Any, last: int, clip: float, clip_vf: float | None) -> None:
        policy_loss, value_loss, _, share, _ = told.mean(axis=0).tolist()
        entropies = -(told[:, 4] + len(self.policy.log_std) * (0.5 + _HALF_LOG_TAU))
        loss = told[-1, 0] + self.ent_coef * entropies[-1] + self.vf_coef * told[-1, 1]
        self.logger.record("train/entropy_loss", float(entropies.mean()))
        self.logger.record("train/policy_gradient_loss", policy_loss)
        self.logger.record("train/value_loss", value_loss)
        self.logger.record("train/approx_kl", float(told[last:, 2].mean()))
        self.logger.record("train/clip_fraction", share)
        self.logger.record("train/loss", float(loss))
        buffer = self.rollout_buffer
        explained = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        self.logger.record("train/explained_variance", explained)
        log_std: Any = self.policy.log_std
        self.logger.record("train/std", float(torch.exp(log_std.detach()).mean()))
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip)
        if clip_vf is not None:
            self.logger.record("train/clip_range_vf", clip_vf)
