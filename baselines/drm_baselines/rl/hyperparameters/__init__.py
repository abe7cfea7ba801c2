"""Training settings as files: one TOML a learning algorithm, read and checked here.

A file states everything a run needs besides the environment and the seed, so that a run can be
repeated from its record. A file of one's own is given with ``--hyperparameters``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from drm_baselines.errors import BaselineError
from drm_baselines.rl.algorithms import ALGORITHMS
from drm_baselines.support.reading import parse_toml, read_table, shown

_ACTIVATIONS = ("tanh", "relu")


@dataclass(frozen=True, kw_only=True)
class Network:
    """Actor and critic: hidden layer sizes, activation, initial log of the action noise.

    With ``critic_sees_payload`` PPO's critic is told the true payload while it trains. TD3, whose
    policy draws nothing, has no ``log_std_init``. Recurrent PPO has ``lstm_layers`` of
    ``lstm_units`` each before the hidden layers, and with ``lstm_critic`` as many for the critic,
    which else sees the present alone.
    """

    layers: tuple[int, ...] = (64, 64)
    activation: str = "tanh"
    log_std_init: float = -2.0
    critic_sees_payload: bool = False
    lstm_units: int = 64
    lstm_layers: int = 1
    lstm_critic: bool = True


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Settings of a training run.

    Attributes
    ----------
    algorithm
        One of `drm_baselines.rl.algorithms.ALGORITHMS`.
    n_envs
        Number of environments stepped as one batch.
    learning_rate, learning_rate_end
        Step size of the optimiser at the start and, linearly in between, at the end.
    torch_threads
        Threads for the network's arithmetic; part of what makes a run repeatable.
    env
        Options of the environment that belong to the method, such as a longer control period;
        options given on the command line win over them.
    fast_updates
        PPO alone: whether the gradient of the loss is the one that is written out in
        ``drm_baselines.rl.fast_ppo``, which is several times as fast as automatic differentiation
        and rounds otherwise.
    model
        Arguments of the algorithm's class in Stable-Baselines3 or its contributions. A number as
        ``action_noise`` is the standard deviation of Gaussian noise, as a fraction of the torque
        limits.
    network
        Shape of the networks.
    """

    algorithm: str
    n_envs: int
    learning_rate: float
    learning_rate_end: float
    torch_threads: int = 1
    fast_updates: bool = False
    env: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)
    network: Network = field(default_factory=Network)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; :func:`from_data` takes them back."""
        data = asdict(self)
        if not self.network.critic_sees_payload:
            # what records have been like before there was a choice
            del data["network"]["critic_sees_payload"]
        if not self.fast_updates:
            del data["fast_updates"]
        if not ALGORITHMS[self.algorithm].remembers:
            for name in _LSTM:
                del data["network"][name]
        return data


_LSTM = ("lstm_units", "lstm_layers", "lstm_critic")
"""Entries of the network that only an algorithm with a memory has."""

MOST_ENVS = 10_000
"""Most environments of a batch that learns."""
MOST_LAYERS = 15
"""Most hidden layers: what can be exported."""
MOST_UNITS = 4096
"""Most units of a hidden layer: what can be exported."""
MOST_LSTM_UNITS = 1024
"""Most hidden units of a layer of LSTM: what can be exported."""
MOST_LSTM_LAYERS = 4
"""Most layers of LSTM: what can be exported."""
MOST_THREADS = 1024
"""Most threads for the network's arithmetic."""


def _refuse(source: str, path: str, expectation: str, value: Any) -> BaselineError:
    return BaselineError(f"{source}: {path} must be {expectation}, got {shown(value)}")


def _positive_int(source: str, path: str, value: Any, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise _refuse(source, path, "a positive integer", value)
    if value > most:
        raise _refuse(source, path, f"at most {most}", value)
    return value


def _number(source: str, path: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _refuse(source, path, "a number", value)
    if not abs(value) < 1e300:  # neither is one that is not a number
        raise _refuse(source, path, "finite", value)
    return float(value)


def from_data(data: Mapping[str, Any], source: str = "hyperparameters") -> Hyperparameters:
    """Check settings given as data and return them; ``source`` names them in errors.

    Raises
    ------
    BaselineError
        A missing, unknown or impossible entry.
    """
    known = {
        "algorithm", "n_envs", "learning_rate", "learning_rate_end", "torch_threads",
        "fast_updates", "env", "model", "network",
    }  # fmt: skip
    unknown = sorted(set(data) - known)
    if unknown:
        raise BaselineError(f"{source}: unknown entry {unknown[0]!r}; there are {sorted(known)}")
    missing = sorted({"algorithm", "n_envs", "learning_rate"} - set(data))
    if missing:
        raise BaselineError(f"{source}: {missing[0]} is missing")
    if data["algorithm"] not in ALGORITHMS:
        raise _refuse(source, "algorithm", f"one of {list(ALGORITHMS)}", data["algorithm"])
    for name in ("env", "model", "network"):
        if not isinstance(data.get(name, {}), Mapping):
            raise _refuse(source, name, "a table", data[name])
    network = dict(data.get("network", {}))
    names = {"layers", "activation", "log_std_init", "critic_sees_payload"}
    if ALGORITHMS[data["algorithm"]].remembers:
        names |= set(_LSTM)
    strange = sorted(set(network) - names)
    if strange:
        raise BaselineError(f"{source}: unknown entry 'network.{strange[0]}'")
    layers = network.get("layers", [64, 64])
    if not isinstance(layers, (list, tuple)) or not 1 <= len(layers) <= MOST_LAYERS:
        raise _refuse(source, "network.layers", f"a list of 1 to {MOST_LAYERS} sizes", layers)
    if network.get("activation", "tanh") not in _ACTIVATIONS:
        raise _refuse(
            source, "network.activation", f"one of {list(_ACTIVATIONS)}", network["activation"]
        )
    privileged = network.get("critic_sees_payload", False)
    if not isinstance(privileged, bool):
        raise _refuse(source, "network.critic_sees_payload", "true or false", privileged)
    if privileged and data["algorithm"] != "ppo":
        raise _refuse(
            source, "network.critic_sees_payload", f"false for {data['algorithm']}", privileged
        )
    own_critic = network.get("lstm_critic", True)
    if not isinstance(own_critic, bool):
        raise _refuse(source, "network.lstm_critic", "true or false", own_critic)
    fast = data.get("fast_updates", False)
    if not isinstance(fast, bool):
        raise _refuse(source, "fast_updates", "true or false", fast)
    if fast and data["algorithm"] != "ppo":
        raise _refuse(source, "fast_updates", f"false for {data['algorithm']}", fast)
    rate = _number(source, "learning_rate", data["learning_rate"])
    end = _number(source, "learning_rate_end", data.get("learning_rate_end", rate))
    if rate <= 0.0 or end < 0.0:
        raise _refuse(source, "learning_rate", "positive and its end not negative", (rate, end))
    return Hyperparameters(
        algorithm=str(data["algorithm"]),
        n_envs=_positive_int(source, "n_envs", data["n_envs"], MOST_ENVS),
        learning_rate=rate,
        learning_rate_end=end,
        torch_threads=_positive_int(
            source, "torch_threads", data.get("torch_threads", 1), MOST_THREADS
        ),
        fast_updates=fast,
        env=dict(data.get("env", {})),
        model=dict(data.get("model", {})),
        network=Network(
            layers=tuple(
                _positive_int(source, "network.layers", size, MOST_UNITS) for size in layers
            ),
            activation=str(network.get("activation", "tanh")),
            log_std_init=_number(source, "network.log_std_init", network.get("log_std_init", -2.0)),
            critic_sees_payload=privileged,
            lstm_units=_positive_int(
                source, "network.lstm_units", network.get("lstm_units", 64), MOST_LSTM_UNITS
            ),
            lstm_layers=_positive_int(
                source, "network.lstm_layers", network.get("lstm_layers", 1), MOST_LSTM_LAYERS
            ),
            lstm_critic=own_critic,
        ),
    )


def load_hyperparameters(algorithm: str, path: Path | None = None) -> Hyperparameters:
    """Read the settings of ``algorithm``: the packaged ones, or those of a TOML file.

    Raises
    ------
    BaselineError
        Unknown algorithm, unreadable file, or settings of another algorithm.
    """
    if algorithm not in ALGORITHMS:
        raise BaselineError(f"no algorithm {algorithm!r}; there are {', '.join(ALGORITHMS)}")
    source = str(path) if path is not None else f"{algorithm}.toml"
    if path is not None:
        data = read_table(path, "hyperparameter file")
    else:
        data = parse_toml(resources.files(__package__).joinpath(source).read_text("utf-8"))
    settings = from_data(data, source)
    if settings.algorithm != algorithm:
        raise BaselineError(f"{source} holds settings of {settings.algorithm}, not {algorithm}")
    return settings
