"""Checks of vector environments, Gymnasium's and Stable-Baselines3's, whoever wrote them.

`check_vector_env` and `check_sb3_vec_env` know nothing of this package's environments: they hold
any batch to what its interface promises.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from drm_env._arguments import count
from drm_env.errors import CheckError, ConfigError

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

__all__ = ["check_sb3_vec_env", "check_vector_env"]

_EPISODES = 2
"""Ends of episodes that are enough in every sub-environment."""


class _Step(NamedTuple):
    """What a step returned: the arrays themselves, and of each episode's end the last observation.

    ``last`` has no entry where the interface does not tell it.
    """

    observations: Any
    rewards: Any
    flags: tuple[Any, ...]
    done: NDArray[np.bool_]
    last: dict[int, Any]


class _Probe(Protocol):
    """A batch with either interface."""

    faults: _Faults
    num_envs: int
    action_space: gym.Space[Any]
    first_step_after_end_resets: bool

    def reset(self, seed: int) -> Any: ...

    def step(self, actions: Any, when: str) -> _Step: ...


class _Faults:
    """What was found, each kind once, with the place where it was seen first."""

    def __init__(self) -> None:
        self.found: dict[str, str] = {}

    def add(self, kind: str, where: str = "") -> None:
        self.found.setdefault(kind, where)

    def expect(self, holds: bool, kind: str, where: str = "") -> bool:
        if not holds:
            self.add(kind, where)
        return bool(holds)

    def texts(self) -> tuple[str, ...]:
        return tuple(f"{kind} ({where})" if where else kind for kind, where in self.found.items())

    def finish(self, subject: object) -> None:
        """Raises what was found.

        Raises
        ------
        CheckError
            There are faults.
        """
        if self.found:
            raise CheckError(type(subject).__name__, self.texts())


# --- values of any space --------------------------------------------------------------------------


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays that a value of a space is made of, and where they are in it."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}[{key!r}]")
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    else:
        yield path, np.asarray(value)


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(_copied(item) for item in value)
    return np.array(value, copy=True)


def _row(value: Any, index: int) -> Any:
    """What one sub-environment has of a batch of values."""
    if isinstance(value, Mapping):
        return {key: _row(item, index) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(_row(item, index) for item in value)
    return value[index]


def _put(value: Any, other: Any, rows: NDArray[np.bool_]) -> Any:
    """A copy of a batch of values with some rows of another."""
    if isinstance(value, Mapping):
        return {key: _put(item, other[key], rows) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(_put(a, b, rows) for a, b in zip(value, other, strict=True))
    mixed = np.array(value, copy=True)
    mixed[rows] = np.asarray(other)[rows]
    return mixed


def _same(one: Any, other: Any, rows: NDArray[np.bool_] | None = None) -> bool:
    """Whether two values are equal to the bit (of a batch in some rows)."""
    first, second = list(_leaves(one)), list(_leaves(other))
    if len(first) != len(second):
        return False
    for (_, a), (_, b) in zip(first, second, strict=True):
        if rows is not None:
            a, b = a[rows], b[rows]
        inexact = np.issubdtype(a.dtype, np.inexact)
        if a.shape != b.shape or not np.array_equal(a, b, equal_nan=bool(inexact)):
            return False
    return True


def _difference(value: Any, space: gym.Space[Any]) -> str:
    """Why a value is not one of a space, as well as it can be said."""
    if isinstance(value, np.ndarray) and isinstance(space, gym.spaces.Box):
        if value.dtype != space.dtype:
            return f"dtype {value.dtype}, the space has {space.dtype}"
        if value.shape != space.shape:
            return f"shape {value.shape}, the space has {space.shape}"
        outside = np.argwhere(~((value >= space.low) & (value <= space.high)))
        if len(outside):
            place = tuple(int(index) for index in outside[0])
            return (
                f"{value[place]!r} at {place}, the space has {space.low[place]!r} to "
                f"{space.high[place]!r}"
            )
    return f"a {type(value).__name__}, the space is {space}"


# --- Gymnasium ------------------------------------------------------------------------------------


class _VectorProbe:
    """Gymnasium's interface, checked at every call."""

    def __init__(self, envs: VectorEnv[Any, Any, Any], faults: _Faults) -> None:
        self.envs, self.faults = envs, faults
        self.num_envs = envs.num_envs
        self.action_space = envs.action_space
        self.mode = envs.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        self.first_step_after_end_resets = self.mode is AutoresetMode.NEXT_STEP
        self._ended = np.zeros(self.num_envs, np.bool_)
        self.shares = getattr(envs.unwrapped, "copy", True) is False

    def reset(self, seed: int | Sequence[int]) -> Any:
        # batches take a seed each, which Gymnasium's annotation leaves out
        returned = self.envs.reset(seed=seed)  # type: ignore[arg-type]
        if not (isinstance(returned, tuple) and len(returned) == 2):
            raise CheckError(
                type(self.envs).__name__,
                (*self.faults.texts(), f"reset must return 2 values, got {returned!r:.80}"),
            )
        observations, infos = returned
        self._observations(observations, "reset")
        self._infos(infos, "reset")
        self._ended[:] = False
        return observations

    def step(self, actions: Any, when: str) -> _Step:
        n, faults = self.num_envs, self.faults
        given = _copied(actions)
        returned = self.envs.step(actions)
        if not (isinstance(returned, tuple) and len(returned) == 5):
            raise CheckError(
                type(self.envs).__name__,
                (*faults.texts(), f"step must return 5 values, got {returned!r:.80}"),
            )
        faults.expect(_same(actions, given), "step changes the actions it is given", when)
        observations, rewards, terminated, truncated, infos = returned
        self._observations(observations, when)
        _check_rewards(rewards, n, faults, when)
        for name, flags in (("terminated", terminated), ("truncated", truncated)):
            _check_flags(name, flags, n, faults, when)
        self._infos(infos, when)
        done = np.logical_or(terminated, truncated).astype(np.bool_).reshape(n)
        last: dict[int, Any] = {}
        if self.mode is AutoresetMode.SAME_STEP:
            last = self._final(observations, infos, done, when)
        else:
            mask = np.asarray(infos.get("_final_obs", False))
            faults.expect(
                not mask.any(), f"infos have final_obs, in the autoreset mode {self.mode}", when
            )
            ends = np.flatnonzero(done).tolist()
            last = {index: _copied(_row(observations, index)) for index in ends}
        if self.mode is AutoresetMode.NEXT_STEP:
            self._after_end(np.asarray(rewards), done, when)
        if self.mode is AutoresetMode.DISABLED and done.any():
            observations = self._reset_where(observations, done, when)
        self._ended = done
        return _Step(observations, rewards, (terminated, truncated), done, last)

    def _observations(self, observations: Any, when: str) -> None:
        space = self.envs.observation_space
        if not space.contains(observations):
            self.faults.add(
                "observations are not in observation_space",
                f"{when}: {_difference(observations, space)}",
            )

    def _infos(self, infos: Any, when: str) -> None:
        if not self.faults.expect(
            isinstance(infos, dict), "infos are not a dictionary", f"{when}: {type(infos).__name__}"
        ):
            return
        for key, value in infos.items():
            arrays = isinstance(value, np.ndarray) and value.shape[:1] == (self.num_envs,)
            if key.startswith("_") or not (arrays or isinstance(value, dict)):
                continue
            mask = infos.get(f"_{key}")
            held = isinstance(mask, np.ndarray) and mask.dtype == np.bool_
            self.faults.expect(
                held and mask.shape == (self.num_envs,),
                f"infos[{key!r}] has no boolean mask infos['_{key}'] of shape ({self.num_envs},)",
                when,
            )

    def _final(
        self, observations: Any, infos: Any, done: NDArray[np.bool_], when: str
    ) -> dict[int, Any]:
        """The last observations in the mode SAME_STEP."""
        faults = self.faults
        mask = np.broadcast_to(np.asarray(infos.get("_final_obs", False)), done.shape)
        last: dict[int, Any] = {}
        if not faults.expect(
            bool((mask == done).all()), "infos['_final_obs'] is not where episodes have ended", when
        ):
            return last
        told = np.broadcast_to(np.asarray(infos.get("_final_info", False)), done.shape)
        faults.expect(
            bool((told == done).all()),
            "infos['_final_info'] is not where episodes have ended",
            when,
        )
        space = self.envs.single_observation_space
        for index in np.flatnonzero(done).tolist():
            final = _row(infos["final_obs"], index)
            last[index] = _copied(final)
            if not space.contains(final):
                faults.add(
                    "infos['final_obs'] is not in single_observation_space",
                    f"{when}: {_difference(final, space)}",
                )
        if last and all(_same(_row(observations, i), final) for i, final in last.items()):
            faults.add(
                "the observation after an end is still the last one, in the mode SAME_STEP it is "
                "the first of the next episode",
                when,
            )
        return last

    def _after_end(self, rewards: NDArray[Any], done: NDArray[np.bool_], when: str) -> None:
        """The step that resets, in the mode NEXT_STEP."""
        ended, faults = self._ended, self.faults
        faults.expect(
            not rewards.reshape(-1)[ended].any(),
            "the step that resets pays a reward, in the mode NEXT_STEP it must be 0",
            when,
        )
        faults.expect(
            not done[ended].any(),
            "the step that resets ends an episode, in the mode NEXT_STEP it begins one",
            when,
        )

    def _reset_where(self, observations: Any, done: NDArray[np.bool_], when: str) -> Any:
        """Resets those that have ended by a mask, in the mode DISABLED."""
        before = _copied(observations)
        after, infos = self.envs.reset(options={"reset_mask": done.copy()})
        self._observations(after, f"{when}, reset_mask")
        self._infos(infos, f"{when}, reset_mask")
        self.faults.expect(
            _same(after, before, ~done), "reset_mask resets others than those of the mask", when
        )
        return after


def _check_rewards(rewards: Any, n: int, faults: _Faults, when: str) -> None:
    array = isinstance(rewards, np.ndarray)
    shown = f"{when}: {rewards.dtype} {rewards.shape}" if array else f"{when}: {type(rewards)}"
    right = array and np.issubdtype(rewards.dtype, np.floating) and rewards.shape == (n,)
    if faults.expect(bool(right), f"rewards are not floating point numbers of shape ({n},)", shown):
        faults.expect(bool(np.isfinite(rewards).all()), "rewards are not finite", when)


def _check_flags(name: str, flags: Any, n: int, faults: _Faults, when: str) -> None:
    array = isinstance(flags, np.ndarray)
    shown = f"{when}: {flags.dtype} {flags.shape}" if array else f"{when}: {type(flags)}"
    right = array and flags.dtype == np.bool_ and flags.shape == (n,)
    faults.expect(bool(right), f"{name} is not a boolean array of shape ({n},)", shown)


def check_vector_env(
    envs: VectorEnv[Any, Any, Any],
    *,
    steps: int = 2000,
    seed: int = 0,
    single: Callable[[], gym.Env[Any, Any]] | None = None,
) -> None:
    """Checks that a vector environment keeps what Gymnasium's interface promises.

    Spaces of the batch are those of the sub-environments batched; observations, rewards, flags and
    infos have their types and shapes; ``reset(seed=s)`` begins the same episodes again and is the
    same as a list s, s + 1, ...; what the metadata say of the autoreset mode is what happens at the
    end of an episode, with ``final_obs`` and ``final_info`` or without; a step does not change its
    actions; arrays that have been returned do not change later, and writing into them changes no
    episode (both not for environments with ``copy=False``); actions of one sub-environment do not
    show in others.

    Flies random actions, several times the same, and leaves the environment in the middle of an
    episode.

    Parameters
    ----------
    envs
        any vector environment, native or around single ones.
    steps
        most steps of one flight; fewer are taken if two episodes have ended everywhere before.
    seed
        of episodes and actions.
    single
        makes one environment alone; sub-environment i must be this one with seed + i, to the bit,
        for an episode. ``None``: that is not checked.

    Raises
    ------
    CheckError
        it does not; the message and ``faults`` name everything that was found.
    ConfigError
        not a vector environment, or impossible arguments.

    Warns
    -----
    UserWarning
        no episode has ended within ``steps``, so that nothing can be said of autoreset.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import drm_env
    >>> envs = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="sync")
    >>> drm_env.check_vector_env(envs, single=lambda: gym.make("CartPole-v1"))
    """
    if not isinstance(envs, VectorEnv):
        raise ConfigError(f"envs must be a gymnasium.vector.VectorEnv, got {type(envs).__name__}")
    steps, seed = count("steps", steps), int(seed)
    faults = _Faults()
    n = getattr(envs, "num_envs", None)
    if not isinstance(n, (int, np.integer)) or n < 1:
        raise CheckError(type(envs).__name__, (f"num_envs must be a positive number, got {n!r}",))
    for name in ("observation_space", "action_space"):
        one, all_of_them = getattr(envs, f"single_{name}"), getattr(envs, name)
        faults.expect(
            all_of_them == batch_space(one, int(n)),
            f"{name} is not single_{name} for {n} environments",
        )
    mode = envs.metadata.get("autoreset_mode")
    faults.expect(
        isinstance(mode, AutoresetMode),
        f"metadata['autoreset_mode'] must be an AutoresetMode, got {mode!r}",
    )
    probe = _VectorProbe(envs, faults)
    first = _copied(probe.reset([seed + index for index in range(n)]))
    faults.expect(
        _same(probe.reset(seed), first),
        "reset(seed=s) is not the same as reset(seed=[s, s + 1, ...])",
    )
    _check_flights(probe, steps, seed, shares=probe.shares, single=single)
    faults.finish(envs)


# --- Stable-Baselines3 ----------------------------------------------------------------------------


class _SB3Probe:
    """Stable-Baselines3's interface, checked at every call."""

    first_step_after_end_resets = False

    def __init__(self, venv: VecEnv, faults: _Faults) -> None:
        self.venv, self.faults = venv, faults
        self.num_envs = venv.num_envs
        self.action_space = batch_space(venv.action_space, venv.num_envs)
        self._space = batch_space(venv.observation_space, venv.num_envs)
        self._infos: list[dict[str, Any]] = []

    def reset(self, seed: int) -> Any:
        self.venv.seed(seed)
        observations = self.venv.reset()
        self._observations(observations, "reset")
        infos = self.venv.reset_infos
        self.faults.expect(
            isinstance(infos, list) and len(infos) == self.num_envs,
            f"reset_infos is not a list of {self.num_envs} dictionaries",
        )
        return observations

    def step(self, actions: Any, when: str) -> _Step:
        n, faults = self.num_envs, self.faults
        given = _copied(actions)
        returned = self.venv.step(actions)
        if not (isinstance(returned, tuple) and len(returned) == 4):
            raise CheckError(
                type(self.venv).__name__,
                (*faults.texts(), f"step must return 4 values, got {returned!r:.80}"),
            )
        faults.expect(_same(actions, given), "step changes the actions it is given", when)
        observations, rewards, dones, infos = returned
        self._observations(observations, when)
        _check_rewards(rewards, n, faults, when)
        _check_flags("dones", dones, n, faults, when)
        done = np.asarray(dones).astype(np.bool_).reshape(n)
        last: dict[int, Any] = {}
        right = isinstance(infos, (list, tuple)) and len(infos) == n
        if faults.expect(
            right and all(isinstance(info, dict) for info in infos),
            f"infos are not a list of {n} dictionaries",
            when,
        ):
            faults.expect(
                len({id(info) for info in [*infos, *self._infos]}) == n + len(self._infos),
                "infos are the same dictionaries for several sub-environments or steps",
                when,
            )
            self._infos = list(infos)
            last = self._last(observations, infos, done, when)
        return _Step(observations, rewards, (dones,), done, last)

    def _observations(self, observations: Any, when: str) -> None:
        if not self._space.contains(observations):
            self.faults.add(
                f"observations are not in observation_space for {self.num_envs} environments",
                f"{when}: {_difference(observations, self._space)}",
            )

    def _last(
        self, observations: Any, infos: Sequence[dict[str, Any]], done: NDArray[np.bool_], when: str
    ) -> dict[int, Any]:
        faults = self.faults
        last: dict[int, Any] = {}
        told = np.array(["terminal_observation" in info for info in infos])
        if not faults.expect(
            bool((told == done).all()),
            "terminal_observation is not in the infos of those that have ended alone",
            when,
        ):
            return last
        for index in np.flatnonzero(done).tolist():
            final = infos[index]["terminal_observation"]
            last[index] = _copied(final)
            if not self.venv.observation_space.contains(final):
                faults.add(
                    "terminal_observation is not in observation_space",
                    f"{when}: {_difference(final, self.venv.observation_space)}",
                )
            by_time = infos[index].get("TimeLimit.truncated")
            faults.expect(
                isinstance(by_time, (bool, np.bool_)),
                "an episode ends and its info does not say in TimeLimit.truncated whether by time",
                when,
            )
        if last and all(_same(_row(observations, i), final) for i, final in last.items()):
            faults.add(
                "the observation after an end is still the last one, it must be the first of the "
                "next episode",
                when,
            )
        return last


def check_sb3_vec_env(
    venv: VecEnv,
    *,
    steps: int = 2000,
    seed: int = 0,
    single: Callable[[], gym.Env[Any, Any]] | None = None,
) -> None:
    """Checks that a batch keeps what Stable-Baselines3 expects of a ``VecEnv``.

    Observations, rewards, dones and infos have their types and shapes; ``seed(s)`` and ``reset()``
    begin the same episodes again; a sub-environment that ends is reset in the same step, and its
    info has ``terminal_observation`` and ``TimeLimit.truncated``; a step does not change its
    actions; arrays and infos that have been returned do not change later, and writing into them
    changes no episode; actions of one sub-environment do not show in others; ``env_is_wrapped`` and
    ``get_attr`` answer for those that are asked. Wrappers that learn from what they see, such as
    ``VecNormalize``, do not begin again: check what is below.

    Flies random actions, several times the same, and leaves the environment in the middle of an
    episode.

    Parameters
    ----------
    venv
        any ``VecEnv``.
    steps, seed, single
        as for `check_vector_env`.

    Raises
    ------
    CheckError
        it does not; the message and ``faults`` name everything that was found.
    ConfigError
        not a ``VecEnv``, or impossible arguments.

    Warns
    -----
    UserWarning
        no episode has ended within ``steps``.
    """
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

    if not isinstance(venv, VecEnv):
        raise ConfigError(f"venv must be a VecEnv, got {type(venv).__name__}")
    steps, seed = count("steps", steps), int(seed)
    faults = _Faults()
    n = getattr(venv, "num_envs", None)
    if not isinstance(n, (int, np.integer)) or n < 1:
        raise CheckError(type(venv).__name__, (f"num_envs must be a positive number, got {n!r}",))
    for indices, number in ((None, n), (0, 1), ([n - 1], 1)):
        wrapped = venv.env_is_wrapped(Monitor, indices=indices)
        faults.expect(
            len(wrapped) == number, f"env_is_wrapped answers {len(wrapped)} times, not {number}"
        )
        modes = venv.get_attr("render_mode", indices=indices)
        faults.expect(len(modes) == number, f"get_attr answers {len(modes)} times, not {number}")
    _check_flights(_SB3Probe(venv, faults), steps, seed, shares=False, single=single)
    faults.finish(venv)


# --- flights, whichever interface -----------------------------------------------------------------


def _copied_step(step: _Step) -> _Step:
    flags = tuple(_copied(flag) for flag in step.flags)
    return _Step(
        _copied(step.observations), _copied(step.rewards), flags, step.done.copy(), step.last
    )


def _equal(one: _Step, other: _Step, rows: NDArray[np.bool_] | None = None) -> bool:
    numbers = (one.observations, one.rewards, one.flags)
    return _same(numbers, (other.observations, other.rewards, other.flags), rows)


def _check_flights(
    probe: _Probe,
    steps: int,
    seed: int,
    *,
    shares: bool,
    single: Callable[[], gym.Env[Any, Any]] | None,
) -> None:
    """Flies the same episodes several times."""
    n, faults = probe.num_envs, probe.faults
    probe.action_space.seed(seed)
    flown: list[_Step] = []
    actions: list[Any] = []
    live: list[tuple[Any, Any]] = []
    first = probe.reset(seed)
    start = _copied(first)
    live.append((first, start))
    ends = np.zeros(n, np.int64)
    while len(flown) < steps and (ends < _EPISODES).any():
        actions.append(_copied(probe.action_space.sample()))
        step = probe.step(_copied(actions[-1]), f"step {len(flown)}")
        flown.append(_copied_step(step))
        if len(live) < 50:
            live.append((tuple(step[:3]), tuple(flown[-1][:3])))
        ends += step.done
    if not ends.any():
        warnings.warn(
            f"no episode has ended in {len(flown)} steps: what happens then was not checked",
            UserWarning,
            stacklevel=3,
        )
    if not shares:
        faults.expect(
            all(_same(now, then) for now, then in live),
            "arrays that were returned change in later calls: they are the batch's own memory",
        )

    again = _repeat(probe, seed, actions, start, flown)
    if not faults.expect(
        again < 0, "the same seed and actions do not fly the same", f"step {again}"
    ):
        return
    if not shares:
        again = _repeat(probe, seed, actions, start, flown, overwrite=True)
        faults.expect(again < 0, "writing into returned arrays changes the flight", f"step {again}")
    # wherever a row's action must not matter, another one
    probe.action_space.seed(seed + 1)
    others = [_copied(probe.action_space.sample()) for _ in actions]
    everywhere = np.ones(n, np.bool_)
    if n > 1:
        rows = everywhere.copy()
        rows[0] = False
        mixed = [_put(a, b, ~rows) for a, b in zip(actions, others, strict=True)]
        again = _repeat(probe, seed, mixed, start, flown, rows=rows)
        faults.expect(
            again < 0, "actions of sub-environment 0 change the flights of others", f"step {again}"
        )
    if probe.first_step_after_end_resets:
        ignored = [np.zeros(n, np.bool_), *(step.done for step in flown[:-1])]
        mixed = [_put(a, b, rows) for a, b, rows in zip(actions, others, ignored, strict=True)]
        again = _repeat(probe, seed, mixed, start, flown)
        faults.expect(
            again < 0,
            "the action of the step that resets is not ignored, in the mode NEXT_STEP it is",
            f"step {again}",
        )
    if single is not None:
        for index in sorted({0, n - 1}):
            _check_single(single, index, seed, actions, start, flown, faults)


def _repeat(
    probe: _Probe,
    seed: int,
    actions: Sequence[Any],
    start: Any,
    flown: Sequence[_Step],
    *,
    overwrite: bool = False,
    rows: NDArray[np.bool_] | None = None,
) -> int:
    """Flies once more; the first step that is another one, or -1."""
    observations = probe.reset(seed)
    if not _same(observations, start, rows):
        return 0
    if overwrite:
        _spoil(observations)
    for index, (action, expected) in enumerate(zip(actions, flown, strict=True)):
        step = probe.step(_copied(action), f"step {index}")
        if not _equal(step, expected, rows):
            return index
        if overwrite:
            _spoil(step[:3])
    return -1


def _spoil(value: Any) -> None:
    """Writes into every array of a value that lets it."""
    for _, array in _leaves(value):
        if array.flags.writeable and array.dtype != object:
            array[...] = 1


def _check_single(
    single: Callable[[], gym.Env[Any, Any]],
    index: int,
    seed: int,
    actions: Sequence[Any],
    start: Any,
    flown: Sequence[_Step],
    faults: _Faults,
) -> None:
    """Holds a sub-environment against a single environment, to the end of its first episode."""
    env = single()
    try:
        kind = "a sub-environment is not the single environment with its seed"
        observation, _ = env.reset(seed=seed + index)
        if not faults.expect(
            _same(observation, _row(start, index)), kind, f"sub-environment {index}, reset"
        ):
            return
        for place, (action, step) in enumerate(zip(actions, flown, strict=True)):
            observation, reward, terminated, truncated, _ = env.step(_row(action, index))
            where = f"sub-environment {index}, step {place}"
            done = bool(step.done[index])
            # float32 is what Stable-Baselines3 has rewards in
            reward = np.asarray(reward, np.asarray(step.rewards).dtype)
            right = reward == step.rewards[index] and (terminated or truncated) == done
            faults.expect(bool(right), kind, f"{where}: rewards or flags")
            shown = step.last.get(index) if done else _row(step.observations, index)
            if shown is not None:
                faults.expect(_same(observation, shown), kind, f"{where}: observations")
            if done or terminated or truncated:
                return
    finally:
        env.close()
