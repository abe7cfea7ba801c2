"""Tries an installed drm-env, from anywhere but the source tree: it flies and says what it is.

    python smoke.py          # the environments, a batch, a law, the engine's picture
    python smoke.py --json   # and sizes, import times, bits of flights as JSON, on the last line

Needs drm-env alone; of drm-baselines what is installed is tried too.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.metadata
import importlib.util
import json
import statistics
import subprocess
import sys
from pathlib import Path

RUNS = 9


def import_seconds(module: str) -> float:
    """Processor time of importing a module in a fresh interpreter."""
    code = f"import time; t = time.process_time(); import {module}; print(time.process_time() - t)"
    seen = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
        for _ in range(RUNS)
    ]
    return statistics.median(seen)


def fingerprint() -> str:
    """SHA-256 of flights: the same wherever the engine is the same, whoever compiled it."""
    import gymnasium as gym
    import numpy as np

    import drm_env

    bits = hashlib.sha256()
    for plant in ("thesis", "consistent"):
        scenarios = drm_env.sample_scenarios(
            "slew", seed=3, n=24, plant=plant, payload_mass=(50.0, 500.0), mass_error=(-0.15, 0.15)
        )
        for law in ("none", "linear", "lyapunov", "servo"):
            for values in drm_env.rollout(scenarios, law=law).values():
                bits.update(np.ascontiguousarray(values).tobytes())
    envs = gym.make_vec("drm_env/SlewFlexible-v0", num_envs=9)
    envs.action_space.seed(0)
    bits.update(envs.reset(seed=0)[0].tobytes())
    for _ in range(50):
        for values in envs.step(envs.action_space.sample())[:4]:
            bits.update(np.ascontiguousarray(values).tobytes())
    return bits.hexdigest()


def main() -> None:
    """Fly, draw, ask and say."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--json", action="store_true")
    given = options.parse_args()

    import gymnasium as gym
    import numpy as np

    import drm_env

    home = Path(drm_env.__file__).parent
    assert "site-packages" in home.parts, f"this is the source tree, not an installation: {home}"
    env = gym.make("drm_env/Slew-v0", payload_mass=(50.0, 500.0), render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert np.asarray(env.render()).std() > 0
    drm_env.check_vector_env(
        gym.make_vec("drm_env/Slew-v1", num_envs=8, horizon=1.0),
        single=lambda: gym.make("drm_env/Slew-v1", horizon=1.0),
    )
    # the largest angle that the thesis prints for this flight, and with this law
    for law, angle in (("none", 56.21), ("lyapunov", 50.07)):
        flown = drm_env.simulate({"payload": {"width": 0.0}, "mass_error": 0.15}, law=law)
        peak = float(np.degrees(flown.metrics["peak_slew_angle"]))
        assert abs(peak - angle) < 0.05, (law, peak)
    said = f"drm-env {importlib.metadata.version('drm-env')} flies"
    if importlib.util.find_spec("drm_baselines"):
        from drm_baselines import make_policy
        from drm_baselines.policies.perceptron import NetworkPolicy

        env = gym.make("drm_env/Slew-v0", control_period=0.002)
        policy = make_policy("learned")
        if isinstance(policy, NetworkPolicy):
            env = gym.make(policy.env_id, config=policy.config)
        action, _ = policy.predict(env.reset(seed=0)[0])
        assert env.action_space.contains(action)
        version = importlib.metadata.version("drm-baselines")
        said += f", and so does a network of drm-baselines {version}"
    print(said)
    if given.json:
        library = next(p for p in home.glob("_engine*") if p.suffix in (".so", ".pyd"))
        own, theirs = import_seconds("drm_env"), import_seconds("gymnasium")
        found = {
            "library_mb": library.stat().st_size / 1e6,
            "package_mb": sum(p.stat().st_size for p in home.rglob("*") if p.is_file()) / 1e6,
            "import_drm_env_ms": 1e3 * own,
            "import_gymnasium_ms": 1e3 * theirs,
            "import_ratio": own / theirs,
            "bits": fingerprint(),
        }
        print(json.dumps(found))


if __name__ == "__main__":
    main()
