"""Exported policies: what is written is what flies, and nothing else is read."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drm_baselines import load_policy
from drm_baselines.errors import PolicyError, RunError
from drm_baselines.policies import policy_file as module
from drm_baselines.policies.perceptron import NetworkPolicy, Perceptron
from drm_baselines.policies.policy_file import save_policy

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
    [
        ("{", "cannot be read"),
        ("", "cannot be read"),
        ("\0", "cannot be read"),
        ("[]", r"is not a JSON object, but \[\]"),
        ("null", "is not a JSON object, but None"),
        ('"drm-policy"', "is not a JSON object"),
        ("{}", "does not describe"),
        ('{"format": "zip"}', "does not describe"),
        ('{"format": "drm-policy"}', "format version None"),
        ('{"format": "drm-policy", "format_version": true}', "format version True"),
        ('{"format": "drm-policy", "format_version": 1}', "lacks layers, activation, output"),
        ('{"format": "drm-policy", "format": "drm-policy"}', "'format' is there twice"),
        ('{"a": NaN}', "NaN is not a number"),
        ('{"a": 1e999}', "1e999 is too large a number"),
        ('{"a": ' + "9" * 5000 + "}", "cannot be read"),
        ("[" * 100_000, "nested more than 32 deep"),
        ('{"a":' * 33 + "0" + "}" * 33, "nested more than 32 deep"),
        ('"' + '\\"' * 500_000, "cannot be read"),
    ],
)
def test_descriptions_that_are_none_are_refused(tmp_path: Path, content: str, message: str) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    (tmp_path / "policy.json").write_text(content)
    with pytest.raises(RunError, match=message) as caught:
        load_policy(tmp_path)
    assert str(tmp_path / "policy.json") in str(caught.value)


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
    from drm_baselines.support.storage import sha256_of

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


def describe_again(folder: Path, **changes: Any) -> None:
    """Rewrites the description with these fields; the weights' digest is made to fit."""
    description = json.loads((folder / "policy.json").read_text())
    weights = (folder / "policy.safetensors").read_bytes()
    description["weights_sha256"] = hashlib.sha256(weights).hexdigest()
    description.update(changes)
    (folder / "policy.json").write_text(json.dumps(description))


def refused(folder: Path, file: str, match: str) -> None:
    """RunError with file and reason."""
    with pytest.raises(RunError, match=match) as caught:
        load_policy(folder)
    assert str(folder / file) in str(caught.value)


LAYOUT = DESCRIPTION["observation_layout"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layers": {}}, "layers must be a list of 1 to 16 layer sizes, got {}"),
        ({"layers": []}, r"layers must be a list of 1 to 16 layer sizes, got \[\]"),
        ({"layers": [[3, 3]] * 17}, "layers must be a list of 1 to 16 layer sizes"),
        ({"layers": [[5, 3], 2]}, r"layers\[1\] must be outputs and inputs, got 2"),
        ({"layers": [[5, 3, 1], [2, 5]]}, r"layers\[0\] must be outputs and inputs"),
        ({"layers": [[4097, 3], [2, 4097]]}, r"layers\[0\] must be layer sizes from 1 to 4096"),
        ({"layers": [[5, 3], [0, 5]]}, r"layers\[1\] must be layer sizes from 1 to 4096"),
        ({"layers": [[5.0, 3], [2, 5]]}, r"layers\[0\] must be layer sizes"),
        ({"layers": [[True, 3], [2, True]]}, r"layers\[0\] must be layer sizes"),
        ({"layers": [[10**30, 3], [2, 10**30]]}, r"layers\[0\] must be layer sizes"),
        ({"layers": [[5, 3], [2, 6]]}, r"layer sizes do not fit: layers\[1\] takes 6 of 5"),
        ({"activation": "sine"}, "activation must be one of relu, tanh, got 'sine'"),
        ({"activation": []}, r"activation must be one of relu, tanh, got \[\]"),
        ({"output": None}, "output must be one of clip, tanh, got None"),
        ({"weights_sha256": 3}, "weights_sha256 must be 64 hexadecimal digits, got 3"),
        ({"weights_sha256": "0" * 63}, "weights_sha256 must be 64 hexadecimal digits"),
        ({"weights_sha256": "0" * 64}, "policy.safetensors does not belong to policy.json"),
        ({"env_id": 3}, "env_id must be text, got 3"),
        ({"config": []}, r"config must be an object, got \[\]"),
        ({"control_period": "0.02"}, "control_period must be a positive number, got '0.02'"),
        ({"control_period": 0}, "control_period must be a positive number, got 0"),
        ({"control_period": True}, "control_period must be a positive number, got True"),
        ({"control_period": 10**250}, "control_period must be a positive number"),
        ({"control_period": 10**400}, "a number of 401 digits is too large"),
        ({"observation_layout": 3}, "observation_layout must be a list of"),
        ({"observation_layout": ["abc"]}, "observation_layout must be a list of"),
        ({"observation_layout": [["a", "m", "1", 0, 1]] * 3}, "observation_layout must be a"),
        ({"observation_layout": [["a", "m", 1.0]] * 3}, "observation_layout must be a list of"),
        ({"observation_layout": LAYOUT[1:]}, "observation_layout has 2 entries, but .* takes 3"),
        ({"observation_layout": LAYOUT * 2}, "observation_layout has 6 entries, but .* takes 3"),
        ({"weights_file": "../else"}, "weights_file must be policy.safetensors, got '../else'"),
        ({"format_version": 2}, "format version 2"),
    ],
)
def test_fields_of_a_description_that_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    describe_again(tmp_path, **changes)
    file = "policy.safetensors" if "does not belong" in message else "policy.json"
    refused(tmp_path, file, message)


def rewritten(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Rewrites the weights as another, whole file of safetensors; the digest is made to fit."""
    from safetensors.numpy import load_file, save_file

    path = folder / "policy.safetensors"
    arrays = load_file(path)
    change(arrays)
    save_file(arrays, path)
    describe_again(folder)


def _cast(dtype: type) -> Callable[[dict[str, Any]], object]:
    return lambda arrays: arrays.update({"layers.1.bias": arrays["layers.1.bias"].astype(dtype)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_cast(np.float64), r"layers.1.bias must hold float32 \(F32\), got 'F64'"),
        (_cast(np.float16), r"layers.1.bias must hold float32 \(F32\), got 'F16'"),
        (_cast(np.int32), r"layers.1.bias must hold float32 \(F32\), got 'I32'"),
        (lambda arrays: arrays.pop("layers.0.weight"), "lacks the array 'layers.0.weight'"),
        (dict.clear, "lacks the array"),
        (
            lambda arrays: arrays.update(more=np.zeros(3, np.float32)),
            "also holds the array 'more'",
        ),
        (
            lambda arrays: arrays.update({"layers.0.weight": np.zeros((3, 5), np.float32)}),
            r"other layer sizes .* layers.0.weight has shape \[3, 5\] instead of \[5, 3\]",
        ),
        (
            lambda arrays: arrays.update({"layers.0.weight": np.zeros(15, np.float32)}),
            r"layers.0.weight has shape \[15\] instead of \[5, 3\]",
        ),
        (
            lambda arrays: arrays["layers.0.weight"].__setitem__((4, 2), np.nan),
            "layers.0.weight holds values that are not finite",
        ),
        (
            lambda arrays: arrays["layers.1.bias"].__setitem__(0, -np.inf),
            "layers.1.bias holds values that are not finite",
        ),
    ],
)
def test_weights_that_are_not_those_announced_are_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    rewritten(tmp_path, change)
    refused(tmp_path, "policy.safetensors", message)


def with_header(folder: Path, header: bytes, data: bytes) -> None:
    content = len(header).to_bytes(8, "little") + header + data
    (folder / "policy.safetensors").write_bytes(content)
    describe_again(folder)


def test_headers_that_lie_are_refused(tmp_path: Path) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    content = (tmp_path / "policy.safetensors").read_bytes()
    length = int.from_bytes(content[:8], "little")
    header, data = json.loads(content[8 : 8 + length]), content[8 + length :]
    text = json.dumps(header).encode()
    with_header(tmp_path, text, data)
    load_policy(tmp_path)

    def lies(match: str, header: bytes, data: bytes = data) -> None:
        with_header(tmp_path, header, data)
        refused(tmp_path, "policy.safetensors", match)

    lies(f"{len(data) - 4} bytes of weights instead of {len(data)}", text, data[:-4])
    lies("bytes of weights instead of", text, data + b"\0\0\0\0")
    lies("is not a JSON object", b"[]")
    lies("nested more than 32 deep", b"[" * 5000)
    lies("no header of safetensors", b" " * (65 << 10))
    lies("must hold float32", json.dumps(header | {"layers.0.bias": 3}).encode())
    lies("is there twice", text[:-1] + b', "layers.0.bias": {}}')
    for offsets in ([0, 20], [-4, 16], [0, 2**70], "0, 20", None):
        wrong = header | {"layers.1.weight": header["layers.1.weight"] | {"data_offsets": offsets}}
        lies("cannot be read", json.dumps(wrong).encode())
    path = tmp_path / "policy.safetensors"
    for content in (b"", b"\0" * 7, (2**63).to_bytes(8, "little") + data):
        path.write_bytes(content)
        describe_again(tmp_path)
        refused(tmp_path, "policy.safetensors", "no header|cannot be read")


@pytest.mark.parametrize(
    ("file", "limit"), [("policy.json", 4 << 20), ("policy.safetensors", 64 << 20)]
)
def test_large_files_are_refused_unread(
    tmp_path: Path, file: str, limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    with (tmp_path / file).open("r+b") as stream:
        stream.truncate(limit + 1)  # takes no room on the disk
    refused(tmp_path, file, f"has {limit + 1} bytes; at most {limit} are read")
    # a file that grows while it is read is cut off too
    real = os.fstat

    def stale(handle: int) -> os.stat_result:
        values = list(real(handle))
        values[6] = 10
        return os.stat_result(values)

    monkeypatch.setattr(module.os, "fstat", stale)
    refused(tmp_path, file, f"more than the {limit} bytes")


@pytest.mark.parametrize("file", ["policy.json", "policy.safetensors"])
def test_what_is_no_ordinary_file_is_refused(tmp_path: Path, file: str) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    save_policy(folder, small_network(), DESCRIPTION)
    path = folder / file
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    refused(folder, file, "not an ordinary file")
    path.unlink()
    path.symlink_to(tmp_path / "nowhere")
    refused(folder, file, "not an ordinary file")
    path.unlink()
    path.mkdir()
    refused(folder, file, "not an ordinary file")
    path.rmdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(path)
        refused(folder, file, "not an ordinary file")
        path.unlink()
    (tmp_path / "elsewhere").rename(path)
    load_policy(folder)
    # the run directory itself may be a link
    (tmp_path / "link").symlink_to(folder)
    load_policy(tmp_path / "link")


def test_files_without_permission_are_refused(tmp_path: Path, as_a_user: None) -> None:
    save_policy(tmp_path, small_network(), DESCRIPTION)
    (tmp_path / "policy.json").chmod(0)
    refused(tmp_path, "policy.json", "cannot be read")


def test_networks_that_could_not_be_loaded_are_not_saved(tmp_path: Path) -> None:
    wide = Perceptron(
        weights=[np.zeros((4097, 3), np.float32), np.zeros((2, 4097), np.float32)],
        biases=[np.zeros(4097, np.float32), np.zeros(2, np.float32)],
        activation="tanh",
        output="clip",
    )
    with pytest.raises(PolicyError, match=r"cannot be exported: layers\[0\]"):
        save_policy(tmp_path, wide, DESCRIPTION)
    assert not any(tmp_path.iterdir())


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, bytes]:
    folder = tmp_path_factory.mktemp("policy")
    weights, description = save_policy(folder, small_network(), DESCRIPTION)
    return folder, weights.read_bytes(), description.read_bytes()


@st.composite
def damage(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Flips bits of a few bytes anywhere, cuts the end off, takes a piece out or puts one in."""
    places = st.floats(0.0, 1.0, exclude_max=True)
    kind = draw(st.sampled_from(["flip", "cut", "remove", "insert"]))
    place, other = draw(places), draw(places)
    flips = draw(st.lists(st.tuples(places, st.integers(1, 255)), min_size=1, max_size=4))
    piece = draw(st.binary(min_size=1, max_size=12))

    def damaged(content: bytes) -> bytes:
        size = len(content)
        begin, end = sorted((int(place * size), int(other * size)))
        if kind == "cut":
            return content[:begin]
        if kind == "remove":
            return content[:begin] + content[end + 1 :]
        if kind == "insert":
            return content[:begin] + piece + content[begin:]
        flipped = bytearray(content)
        for where, bits in flips:
            flipped[int(where * size)] ^= bits
        return bytes(flipped)

    return damaged


fuzz = settings(max_examples=200, deadline=None)


@fuzz
@given(change=damage())
def test_any_damage_of_the_weights_is_noticed(
    saved: tuple[Path, bytes, bytes], change: Callable[[bytes], bytes]
) -> None:
    folder, weights, description = saved
    damaged = change(weights)
    (folder / "policy.safetensors").write_bytes(damaged)
    (folder / "policy.json").write_bytes(description)
    if damaged == weights:
        load_policy(folder)
    else:
        refused(folder, "policy.safetensors", "SHA-256")


def loads_or_refuses(folder: Path) -> None:
    """Either RunError or a policy of finite numbers, and nothing else."""
    try:
        policy = load_policy(folder)
    except RunError:
        return
    assert (policy.network.inputs, policy.network.outputs) == (3, 2)
    assert all(np.isfinite(weight).all() for weight in policy.network.weights)


@fuzz
@given(change=damage())
def test_weights_with_a_forged_digest_load_or_are_refused(
    saved: tuple[Path, bytes, bytes], change: Callable[[bytes], bytes]
) -> None:
    folder, weights, description = saved
    (folder / "policy.safetensors").write_bytes(change(weights))
    (folder / "policy.json").write_bytes(description)
    describe_again(folder)
    loads_or_refuses(folder)


@fuzz
@given(change=damage())
def test_damaged_headers_with_a_forged_digest_load_or_are_refused(
    saved: tuple[Path, bytes, bytes], change: Callable[[bytes], bytes]
) -> None:
    folder, weights, description = saved
    length = int.from_bytes(weights[:8], "little")
    (folder / "policy.json").write_bytes(description)
    with_header(folder, change(weights[8 : 8 + length]), weights[8 + length :])
    loads_or_refuses(folder)


@fuzz
@given(change=damage())
def test_damaged_descriptions_load_or_are_refused(
    saved: tuple[Path, bytes, bytes], change: Callable[[bytes], bytes]
) -> None:
    folder, weights, description = saved
    (folder / "policy.safetensors").write_bytes(weights)
    (folder / "policy.json").write_bytes(change(description))
    loads_or_refuses(folder)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


@fuzz
@given(
    name=st.sampled_from([
        "format", "format_version", "layers", "activation", "output", "weights_file",
        "weights_sha256", "env_id", "config", "control_period", "observation_layout",
    ]),
    value=json_values,
)  # fmt: skip
def test_fields_of_any_form_load_or_are_refused(
    saved: tuple[Path, bytes, bytes], name: str, value: Any
) -> None:
    folder, weights, description = saved
    (folder / "policy.safetensors").write_bytes(weights)
    content = json.loads(description) | {name: value}
    (folder / "policy.json").write_text(json.dumps(content))
    loads_or_refuses(folder)
