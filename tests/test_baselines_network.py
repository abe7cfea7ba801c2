"""Exported policies: what is written is what flies, and nothing else is read."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drm_baselines import load_policy
from drm_baselines.errors import PolicyError, RunError
from drm_baselines.network import NetworkPolicy, Perceptron, save_policy

DESCRIPTION: dict[str, Any] = {
    "env_id": "drm_env/SlewResidual-v0",
    "config": {},
    "control_period": 0.02,
    "observation_layout": [["a", "m", 1.0, -1.0, 1.0]] * 3,
}


def small_network(output: str = "clip", activation: str = "tanh") -> Perceptron:
    rng = np.random.default_rng(4)
    sizes = [3, 5, 2]
    return Perceptron(
        weights=[
            rng.normal(size=(outputs, inputs)).astype(np.float32)
            for inputs, outputs in itertools.pairwise(sizes)
        ],
        biases=[rng.normal(size=size).astype(np.float32) for size in sizes[1:]],
        activation=activation,
        output=output,
    )


def test_a_network_by_hand() -> None:
    network = Perceptron(
        weights=[np.array([[1.0, -1.0]], np.float32), np.array([[2.0]], np.float32)],
        biases=[np.array([0.5], np.float32), np.array([-0.25], np.float32)],
        activation="relu",
        output="tanh",
    )
    # relu(1 - 2 + 0.5) = 0; relu(2 - 1 + 0.5) = 1.5
    expected = np.tanh([[-0.25], [2.75]])
    np.testing.assert_allclose(network([[1.0, 2.0], [2.0, 1.0]]), expected, rtol=1e-6)


def test_saved_policies_come_back_bit_for_bit(tmp_path: Path) -> None:
    network = small_network()
    save_policy(tmp_path, network, DESCRIPTION)
    policy = load_policy(tmp_path)
    assert policy.control_period == 0.02
    observations = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)
    np.testing.assert_array_equal(policy.predict(observations)[0], network(observations))


def test_shapes_of_single_and_batched_observations() -> None:
    policy = NetworkPolicy(small_network(), DESCRIPTION)
    batch = np.random.default_rng(1).normal(size=(4, 3)).astype(np.float32)
    actions, state = policy.predict(batch, state=None, episode_start=np.ones(4, bool))
    assert (actions.shape, actions.dtype, state) == ((4, 2), np.float32, None)
    single, _ = policy.predict(batch[2])
    assert single.shape == (2,)
    np.testing.assert_allclose(single, actions[2], rtol=1e-6)
    assert np.abs(policy.predict(100.0 * batch)[0]).max() <= 1.0


def test_unfit_observations_and_random_actions_are_refused() -> None:
    policy = NetworkPolicy(small_network(), DESCRIPTION)
    with pytest.raises(PolicyError, match="3 entries"):
        policy.predict(np.zeros(4))
    with pytest.raises(PolicyError, match="deterministic"):
        policy.predict(np.zeros(3), deterministic=False)


def test_damaged_weights_are_refused(tmp_path: Path) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    path = tmp_path / "policy.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(RunError, match="SHA-256"):
        load_policy(tmp_path)


def test_weights_of_another_shape_are_refused(tmp_path: Path) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    path = tmp_path / "policy.json"
    description = json.loads(path.read_text())
    description["layers"][0] = [6, 3]
    path.write_text(json.dumps(description))
    with pytest.raises(RunError, match="layer sizes"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [("{", "cannot be read"), ("[]", "does not describe"), ('{"format": "zip"}', "describe")],
)
def test_descriptions_that_are_none_are_refused(tmp_path: Path, content: str, message: str) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    (tmp_path / "policy.json").write_text(content)
    with pytest.raises(RunError, match=message):
        load_policy(tmp_path)


def test_directories_without_a_policy_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run directory"):
        load_policy(tmp_path / "missing")
    with pytest.raises(RunError, match=r"holds no policy\.json"):
        load_policy(tmp_path)


def test_a_pickle_in_place_of_weights_is_not_executed(tmp_path: Path) -> None:
    import pickle

    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "exploded",))

    save_policy(tmp_path, small_network(), DESCRIPTION)
    weights = tmp_path / "policy.safetensors"
    weights.write_bytes(pickle.dumps(Bomb()))
    from drm_baselines.storage import sha256_of

    description = json.loads((tmp_path / "policy.json").read_text())
    description["weights_sha256"] = sha256_of(weights)
    (tmp_path / "policy.json").write_text(json.dumps(description))
    with pytest.raises(RunError, match="cannot be read"):
        load_policy(tmp_path)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"activation": "sine"}, "activation"),
        ({"output": "none"}, "output"),
        ({"biases": []}, "bias"),
        ({"weights": [np.zeros((5, 3), np.float32), np.zeros((2, 4), np.float32)]}, "4 inputs"),
        ({"biases": [np.full(5, np.nan, np.float32), np.zeros(2, np.float32)]}, "finite"),
    ],
)
def test_impossible_networks_are_refused(changes: dict[str, Any], message: str) -> None:
    network = small_network()
    parts = {
        "weights": network.weights, "biases": network.biases,
        "activation": network.activation, "output": network.output,
    }  # fmt: skip
    with pytest.raises(PolicyError, match=message):
        Perceptron(**{**parts, **changes})
