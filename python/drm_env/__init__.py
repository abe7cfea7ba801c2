"""Gymnasium environments of the Deployable Robotic Manipulator, simulated in Rust.

Importing this package registers

    drm_env/Slew-v1           two reaction wheels at 10 Hz, made for learning from scratch
    drm_env/SlewResidual-v1   the same, as a correction to an inner law at 500 Hz
    drm_env/Slew-v0           two reaction wheels at 100 Hz, the payload drawn and misreported
    drm_env/SlewResidual-v0   the same, as a correction at 50 Hz to an inner law at 500 Hz
    drm_env/SlewThesis-v0     the thesis' manoeuvre: nothing random, 500 Hz
    drm_env/SlewDirect-v0     as Slew, and the slew motor is the agent's too
    drm_env/SlewFlexible-v0   an arm that one could build: flexible, with real wheels and sensors
    drm_env/Mission-v0        pick, slew, place, return: several legs an episode

>>> import gymnasium as gym
>>> import drm_env
>>> env = gym.make("drm_env/Slew-v0", payload_mass=(50.0, 500.0))
>>> vec = gym.make_vec("drm_env/Slew-v0", num_envs=1024)
>>> trajectory = drm_env.simulate({"payload": {"mass": 200.0}}, law="lyapunov")

Units are SI and radians throughout.
"""

from __future__ import annotations

import importlib
import warnings as _warnings
from typing import TYPE_CHECKING, Any

import gymnasium as _gym

from drm_env._engine import load as _load
from drm_env._engine import task_names as _task_names

# here, where a signal that comes between is raised like everywhere else
_load()

if TYPE_CHECKING:
    from drm_env._config import EnvConfig, Scenario, Task
    from drm_env._engine import __version__
    from drm_env._infos import NO_VALUE, info_metrics
    from drm_env.checking import check_sb3_vec_env, check_vector_env
    from drm_env.configuration import default_config, option_names
    from drm_env.distributions import Choices, LogUniform, Normal, Uniform
    from drm_env.env import DrmEnv
    from drm_env.errors import (
        ActionError,
        ActionTypeError,
        CheckError,
        ConfigError,
        DrmError,
        EnvironmentClosedError,
        InfeasibleError,
        ResetNeededError,
        SimulationError,
        SnapshotError,
        UnknownOptionError,
    )
    from drm_env.film import Film
    from drm_env.kinematics import (
        ArmPosition,
        Workspace,
        inverse_kinematics,
        tip_position,
        workspace,
    )
    from drm_env.law import ControlLaw
    from drm_env.loads import LOAD_SYMBOLS, LoadEntry, load_signals
    from drm_env.metrics import METRIC_SYMBOLS, MetricEntry, episode_metrics
    from drm_env.missions import LegRecord
    from drm_env.model import Model
    from drm_env.network import Network
    from drm_env.observation import ObservationEntry, observation_layout
    from drm_env.planning import SlewCandidate, SlewPlan, plan_slew
    from drm_env.profiles import SlewMotion, slew_acceleration, slew_final_time, slew_motion
    from drm_env.resolution import resolve
    from drm_env.resolved import ResolvedConfig
    from drm_env.rigid_demands import slew_demands
    from drm_env.rollouts import Rollout, rollout
    from drm_env.simulation import Trajectory, sample_scenarios, simulate
    from drm_env.slew_limits import SlewLimits
    from drm_env.transition import Transitions, transitions
    from drm_env.vector import DrmVectorEnv

__all__ = [
    "LOAD_SYMBOLS",
    "METRIC_SYMBOLS",
    "NO_VALUE",
    "ActionError",
    "ActionTypeError",
    "ArmPosition",
    "CheckError",
    "Choices",
    "ConfigError",
    "ControlLaw",
    "DrmEnv",
    "DrmError",
    "DrmVectorEnv",
    "EnvConfig",
    "EnvironmentClosedError",
    "Film",
    "InfeasibleError",
    "LegRecord",
    "LoadEntry",
    "LogUniform",
    "MetricEntry",
    "Model",
    "Network",
    "Normal",
    "ObservationEntry",
    "ResetNeededError",
    "ResolvedConfig",
    "Rollout",
    "Scenario",
    "SimulationError",
    "SlewCandidate",
    "SlewLimits",
    "SlewMotion",
    "SlewPlan",
    "SnapshotError",
    "Task",
    "Trajectory",
    "Transitions",
    "Uniform",
    "UnknownOptionError",
    "Workspace",
    "__version__",
    "check_sb3_vec_env",
    "check_vector_env",
    "default_config",
    "episode_metrics",
    "info_metrics",
    "inverse_kinematics",
    "load_signals",
    "observation_layout",
    "option_names",
    "plan_slew",
    "resolve",
    "rollout",
    "sample_scenarios",
    "simulate",
    "slew_acceleration",
    "slew_demands",
    "slew_final_time",
    "slew_motion",
    "tip_position",
    "transitions",
    "workspace",
]

_HOMES = {
    "_config": ["EnvConfig", "Scenario", "Task"],
    "_engine": ["__version__"],
    "_infos": ["NO_VALUE", "info_metrics"],
    "checking": ["check_sb3_vec_env", "check_vector_env"],
    "configuration": ["default_config", "option_names"],
    "distributions": ["Choices", "LogUniform", "Normal", "Uniform"],
    "env": ["DrmEnv"],
    "errors": [
        "ActionError",
        "ActionTypeError",
        "CheckError",
        "ConfigError",
        "DrmError",
        "EnvironmentClosedError",
        "InfeasibleError",
        "ResetNeededError",
        "SimulationError",
        "SnapshotError",
        "UnknownOptionError",
    ],
    "film": ["Film"],
    "kinematics": [
        "ArmPosition",
        "Workspace",
        "inverse_kinematics",
        "tip_position",
        "workspace",
    ],
    "law": ["ControlLaw"],
    "loads": ["LOAD_SYMBOLS", "LoadEntry", "load_signals"],
    "metrics": ["METRIC_SYMBOLS", "MetricEntry", "episode_metrics"],
    "missions": ["LegRecord"],
    "model": ["Model"],
    "network": ["Network"],
    "observation": ["ObservationEntry", "observation_layout"],
    "planning": ["SlewCandidate", "SlewPlan", "plan_slew"],
    "profiles": ["SlewMotion", "slew_acceleration", "slew_final_time", "slew_motion"],
    "resolution": ["resolve"],
    "resolved": ["ResolvedConfig"],
    "rollouts": ["Rollout", "rollout"],
    "simulation": ["Trajectory", "sample_scenarios", "simulate"],
    "rigid_demands": ["slew_demands"],
    "slew_limits": ["SlewLimits"],
    "transition": ["Transitions", "transitions"],
    "vector": ["DrmVectorEnv"],
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first used, which keeps the import of the package fast."""
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)


def _register() -> None:
    # v1 of a task is another task, made for learning; Gymnasium would call v0 out of date
    _warnings.filterwarnings(
        "ignore",
        message=r".*The environment drm_env/\w+-v0 is out of date",
        category=DeprecationWarning,
    )
    # No step limit is registered: the horizon is an option, and the environment truncates there.
    for task in _task_names():
        words, _, version = task.partition("_v")
        name = "".join(word.capitalize() for word in words.split("_")) + f"-v{version or 0}"
        _gym.register(
            id=f"drm_env/{name}",
            entry_point="drm_env.env:DrmEnv",
            vector_entry_point="drm_env.vector:DrmVectorEnv",
            kwargs={"task": task},
        )


_register()
