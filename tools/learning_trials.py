"""Trains with plain Stable-Baselines3 on the old and the new tasks and draws the learning curves.

Every trial is a library's algorithm with its own default hyperparameters, but for the number of
environments, of steps between updates and of samples in a minibatch (PPO: 32, 128 and 256). Points
of a curve are 256 episodes that no training draws, flown by the deterministic policy, the same for
all trials; minutes are those of the processor, of one thread, without the evaluations.

    python tools/learning_trials.py --list
    python tools/learning_trials.py ppo-slew-v1 ppo-slew-v0 --seeds 0 1 2
    python tools/learning_trials.py --draw                # table and picture from what is recorded

Records are rows of docs/learning.csv, of which a trial replaces its own; the table goes into
docs/learning.md and the picture into docs/images/learning_old_and_new.png.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import drm_env
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_law, fly_policy
from drm_baselines.evaluation.records import Episodes
from drm_baselines.evaluation.statistics import interquartile_estimate
from drm_baselines.support.markers import marked_range
from drm_baselines.support.seeds import CURVE_SEED, training_seed

ROOT = Path(__file__).resolve().parent.parent
RECORDS = ROOT / "docs" / "learning.csv"
PAGE = ROOT / "docs" / "learning.md"
PICTURE = ROOT / "docs" / "images" / "learning_old_and_new.png"
EPISODES = 256
MARKERS = "<!-- learning trials -->", "<!-- /learning trials -->"
LINEAR_MARKERS = "<!-- linear policies -->", "<!-- /linear policies -->"
SLEW, RESIDUAL = "end to end", "residual on the linear law"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One algorithm on one task.

    Attributes
    ----------
    title, group
        How it is called in the table and the picture, and the panel it is drawn in.
    algorithm, env_id, options
        What learns, and where; options of the environment other than its defaults.
    steps
        Environment steps over all environments.
    n_envs, settings
        Number of environments, and what else differs from the library's defaults.
    """

    title: str
    group: str
    algorithm: str
    env_id: str
    options: Mapping[str, Any] = field(default_factory=dict)
    steps: int = 1_000_000
    n_envs: int = 32
    settings: Mapping[str, Any] = field(default_factory=lambda: {"n_steps": 128})


PPO = {"n_steps": 128, "batch_size": 256}
TRIALS: dict[str, Trial] = {
    "ppo-slew-v1": Trial(
        title="PPO on Slew-v1", group=SLEW, algorithm="ppo", env_id="drm_env/Slew-v1", settings=PPO
    ),
    "ppo-slew-v0": Trial(
        title="PPO on Slew-v0, decisions every 0.1 s",
        group=SLEW,
        algorithm="ppo",
        env_id="drm_env/Slew-v0",
        options={"control_period": 0.1},
        settings=PPO,
    ),
    **{
        f"{title.lower()}-slew-v1": Trial(
            title=f"{title} on Slew-v1",
            group=SLEW,
            algorithm=title.lower(),
            env_id="drm_env/Slew-v1",
            steps=40_000,
            n_envs=4,
            settings={},
        )
        for title in ("SAC", "TQC", "CrossQ")
    },
    "ppo-residual-v1": Trial(
        title="PPO on SlewResidual-v1",
        group=RESIDUAL,
        algorithm="ppo",
        env_id="drm_env/SlewResidual-v1",
        settings=PPO,
    ),
    "ppo-residual-v1-quiet": Trial(
        title="PPO on SlewResidual-v1, less noise (docs/training.md)",
        group=RESIDUAL,
        algorithm="ppo",
        env_id="drm_env/SlewResidual-v1",
        settings={**PPO, "policy_kwargs": {"log_std_init": -2.0}},
    ),
    "ppo-residual-v0": Trial(
        title="PPO on SlewResidual-v0, decisions every 0.1 s",
        group=RESIDUAL,
        algorithm="ppo",
        env_id="drm_env/SlewResidual-v0",
        options={"control_period": 0.1},
        settings=PPO,
    ),
}

Weights = Mapping[str, tuple[float, float]]
"""Weights of entries of the observation on the root wheel and the tip wheel."""

FOUR: Weights = {
    "tip_error": (-1.5, -1.3),
    "slew_error_rate": (-0.7, -0.4),
    "link2_deflection": (-4.2, -1.3),
    "link2_deflection_rate": (-4.0, -0.8),
}
THREE: Weights = {
    "tip_error": (-1.0, -0.3),
    "mean_tip_rate": (-2.0, -0.6),
    "missing_torque": (1.0, 0.0),
}
LINEAR: tuple[tuple[str, str, Weights], ...] = (
    ("wheels off", "Slew-v1", {}),
    ("-1.5 `tip_error` on the root wheel", "Slew-v1", {"tip_error": (-1.5, 0.0)}),
    ("four entries", "Slew-v1", FOUR),
    ("a third of that", "Slew-v1", {n: (a / 3.0, b / 3.0) for n, (a, b) in FOUR.items()}),
    ("`-tip_error`, `-2 mean_tip_rate`", "Slew-v1", {n: w for n, w in THREE.items() if w[0] < 0}),
    ("the same and `missing_torque`", "Slew-v1", THREE),
    (
        "and `still_tip_error` for `tip_error`",
        "Slew-v1",
        {**THREE, "tip_error": (0.0, 0.0), "still_tip_error": (-0.2, -0.06)},
    ),
    ("the linear law alone", "SlewResidual-v1", {}),
    *(
        (
            f"and -{weight:g} `{entry}` on the root wheel",
            "SlewResidual-v1",
            {entry: (-weight, 0.0)},
        )
        for weight, entry in (
            (1.0, "tip_error_fine"),
            (3.0, "tip_error_fine"),
            (1.0, "still_tip_error_fine"),
            (3.0, "still_tip_error_fine"),
        )
    ),
)
"""Policies that are one linear map: title, task, weights."""

OLD_REWARD = {"resolution": 1e-4, "linear": 0.0, "slew_time": 2.5, "with_deflection": False}
"""What version 0 pays."""

COLUMNS = (
    "trial", "algorithm", "env_id", "n_envs", "seed", "steps", "updates", "minutes", "episodes",
    "tip_error_rms", "low", "high", "residual_rms", "settled",
)  # fmt: skip


def judge(flown: Episodes) -> dict[str, float]:
    """Figures of a point: interquartile means (m), the first with its interval, and a share."""
    error = interquartile_estimate(flown.judged("tip_error_rms"))
    return {
        "episodes": len(flown),
        "tip_error_rms": error.value,
        "low": error.low,
        "high": error.high,
        "residual_rms": interquartile_estimate(flown.judged("residual_rms")).value,
        "settled": float(np.mean(flown.judged("settled"))),
    }


def algorithms() -> dict[str, Any]:
    """The algorithms that are installed, by name."""
    import importlib

    import stable_baselines3 as sb3

    found: dict[str, Any] = {"ppo": sb3.PPO, "sac": sb3.SAC, "td3": sb3.TD3}
    try:
        contrib = importlib.import_module("sb3_contrib")
    except ImportError:
        return found
    return {**found, "tqc": contrib.TQC, "crossq": contrib.CrossQ}


def run(name: str, seed: int, steps: int | None = None, points: int = 10) -> None:
    """Train once; records each point of the learning curve as it is reached."""
    from stable_baselines3.common.callbacks import BaseCallback

    from drm_env.sb3 import make_sb3_vec

    trial = TRIALS[name]
    budget = trial.steps if steps is None else steps
    config = environment_config(trial.env_id, trial.options)
    env = make_sb3_vec(trial.env_id, n_envs=trial.n_envs, config=config, step_context=False)
    model = algorithms()[trial.algorithm](
        "MlpPolicy", env, seed=seed, device="cpu", **trial.settings
    )
    # the model has seeded them with its own seed, of which evaluations may be
    env.seed(training_seed(seed, 0))
    rows: list[dict[str, Any]] = []
    spacing = budget // points
    begun = time.process_time()
    apart = 0.0

    def point() -> None:
        nonlocal apart
        now = time.process_time()
        flown = fly_policy(
            model, trial.env_id, config, seed=CURVE_SEED, episodes=EPISODES, label=trial.title
        )
        row = {
            "trial": name, "algorithm": trial.algorithm, "env_id": trial.env_id,
            "n_envs": trial.n_envs, "seed": seed, "steps": model.num_timesteps,
            "updates": model.num_timesteps // (model.n_steps * trial.n_envs)
            if trial.algorithm == "ppo"
            else model._n_updates,
            "minutes": (now - begun - apart) / 60.0, **judge(flown),
        }  # fmt: skip
        rows.append(row)
        keep(rows)
        apart += time.process_time() - now
        print(
            f"{name}, seed {seed}: {row['steps']:,} steps, {row['updates']:,} updates, "
            f"{row['minutes']:.1f} min: {1e3 * row['tip_error_rms']:.4g} mm, "
            f"{100 * row['settled']:.0f} % settled",
            flush=True,
        )

    class Curve(BaseCallback):
        def _on_rollout_start(self) -> None:
            if self.num_timesteps >= len(rows) * spacing:
                point()

        def _on_step(self) -> bool:
            return True

    model.learn(budget, callback=Curve())
    if rows[-1]["steps"] < model.num_timesteps:
        point()
    env.close()


def read() -> list[dict[str, Any]]:
    """The rows that are recorded."""
    if not RECORDS.is_file():
        return []
    text = {"trial", "algorithm", "env_id"}
    with RECORDS.open(newline="", encoding="utf-8") as stream:
        return [
            {k: v if k in text else float(v) for k, v in row.items()}
            for row in csv.DictReader(stream)
        ]


def keep(rows: list[dict[str, Any]]) -> None:
    """Record rows, instead of those of the same trial and seed."""
    new = {(row["trial"], int(row["seed"])) for row in rows}
    old = [row for row in read() if (row["trial"], int(row["seed"])) not in new]
    every = sorted([*old, *rows], key=lambda r: (r["trial"], int(r["seed"]), int(r["steps"])))
    with RECORDS.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in every:
            writer.writerow(
                {k: v if isinstance(v, str) else f"{float(v):.6g}" for k, v in row.items()}
            )


def laws(env_id: str = "drm_env/Slew-v1") -> dict[str, dict[str, float]]:
    """The thesis' laws and the open loop on the same episodes, at the laws' own 2 ms."""
    config = environment_config(env_id, {})
    return {
        name: judge(
            fly_law({"name": name}, config, env_id=env_id, seed=CURVE_SEED, episodes=EPISODES)
        )
        for name in ("none", "lyapunov", "linear")
    }


def fly_linear(task: str, weights: Weights, options: Mapping[str, Any]) -> Episodes:
    """Fly a policy that is one linear map of the observation."""
    env_id = f"drm_env/{task}"
    config = environment_config(env_id, options)
    layout = drm_env.observation_layout(config=config)
    matrix = np.array([weights.get(e.name, (0.0, 0.0)) for e in layout], dtype=np.float32)

    class Linear:
        control_period = config.task.control_period

        def predict(
            self,
            observation: Any,
            state: Any = None,
            episode_start: Any = None,
            deterministic: bool = True,
        ) -> tuple[Any, Any]:
            del episode_start, deterministic
            return np.clip(observation @ matrix, -1.0, 1.0), state

    return fly_policy(Linear(), env_id, config, seed=CURVE_SEED, episodes=EPISODES, label="linear")


def write_linear() -> None:
    """Write the table of linear policies into the page."""
    lines = [
        "| actions | tip error RMS (mm) | residual vibration RMS (mm) | settled (%) | return, "
        "version 0 | return, version 1 |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for title, task, weights in LINEAR:
        flown = fly_linear(task, weights, {})
        old = fly_linear(task, weights, {"reward": OLD_REWARD})
        figures = judge(flown)
        lines.append(
            f"| {title} | {_interval(figures)} | {1e3 * figures['residual_rms']:.2g} | "
            f"{100 * figures['settled']:.0f} | {np.mean(old.metrics['episode_return']):.1f} | "
            f"{np.mean(flown.metrics['episode_return']):.1f} |"
        )
    insert(LINEAR_MARKERS, lines)


def insert(markers: tuple[str, str], lines: list[str]) -> None:
    """Put lines between two markers of the page."""
    text = PAGE.read_text(encoding="utf-8")
    place = marked_range(text, *markers, where=str(PAGE))
    if place is None:
        raise SystemExit(f"{PAGE} has no {markers[0]}")
    body = "\n".join([markers[0], *lines, markers[1]])
    PAGE.write_text(text[: place[0]] + body + text[place[1] :], encoding="utf-8")


def draw(rows: list[dict[str, Any]]) -> None:
    """Draw the curves, one panel a group, and write the table into the page."""
    from drm_baselines.policies.names import POLICIES
    from drm_baselines.support.figures import LINES, SEQUENCE, plain_log, save_figure, subplots

    known = {row["trial"] for row in rows}
    groups = [g for g in (SLEW, RESIDUAL) if any(TRIALS[n].group == g for n in known)]
    fixed = laws()
    figure, axes = subplots(1, len(groups), size=(6.2 * len(groups), 4.6))
    lines = []
    for axis, group in zip(axes[0], groups, strict=True):
        for name in ("none", "lyapunov", "linear"):
            level = 1e3 * fixed[name]["tip_error_rms"]
            axis.axhline(level, color="0.6", linewidth=0.8)
            axis.annotate(
                POLICIES[name].title, (1.0, level), xycoords=("axes fraction", "data"),
                ha="right", va="bottom", fontsize=7, color="0.4",
            )  # fmt: skip
        for index, (name, trial) in enumerate(
            (n, t) for n, t in TRIALS.items() if t.group == group and n in known
        ):
            own = [row for row in rows if row["trial"] == name]
            for seed in sorted({row["seed"] for row in own}):
                curve = [row for row in own if row["seed"] == seed]
                first = seed == min(row["seed"] for row in own)
                axis.plot(
                    [row["steps"] / 1e6 for row in curve],
                    [1e3 * row["tip_error_rms"] for row in curve],
                    color=SEQUENCE[index % len(SEQUENCE)],
                    linestyle=LINES[index // len(SEQUENCE)],
                    marker=".",
                    label=trial.title if first else None,
                )
        axis.set_yscale("log")
        axis.set_title(group)
        axis.set_xlabel("environment steps (millions)")
        axis.set_ylabel("tip error RMS (mm)")
        plain_log(axis.yaxis)
        axis.legend(fontsize=7)
    save_figure(figure, PICTURE, overwrite=True)
    lines.append(
        "| task | trial | seed | steps | updates | minutes | tip error RMS (mm) | settled (%) |"
    )
    lines.append("|---|---|---:|---:|---:|---:|---:|---:|")
    for name in ("none", "lyapunov", "linear"):
        figures = fixed[name]
        lines.append(
            f"| the same episodes | {POLICIES[name].title}, 2 ms | - | - | - | - | "
            f"{_interval(figures)} | {100 * figures['settled']:.0f} |"
        )
    for name, trial in TRIALS.items():
        own = [row for row in rows if row["trial"] == name]
        for seed in sorted({row["seed"] for row in own}):
            last = max((r for r in own if r["seed"] == seed), key=lambda row: float(row["steps"]))
            lines.append(
                f"| {trial.group} | {trial.title} | {int(seed)} | {int(last['steps']):,} | "
                f"{int(last['updates']):,} | {last['minutes']:.1f} | {_interval(last)} | "
                f"{100 * last['settled']:.0f} |"
            )
    insert(MARKERS, lines)


def _interval(figures: Mapping[str, float]) -> str:
    value, low, high = (1e3 * figures[name] for name in ("tip_error_rms", "low", "high"))
    return f"{value:,.3g} [{low:,.3g}, {high:,.3g}]"


def main(arguments: list[str]) -> None:
    """Train, record, draw."""
    import torch

    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("trials", nargs="*", choices=[*TRIALS, []], help="which; none: no training")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--list", action="store_true", help="list the trials")
    parser.add_argument("--steps", type=int, help="instead of the trial's own")
    parser.add_argument("--draw", action="store_true", help="write table and picture")
    parser.add_argument("--linear", action="store_true", help="fly linear policies, write a table")
    given = parser.parse_args(arguments)
    if given.list:
        for name, trial in TRIALS.items():
            print(f"{name:24} {trial.title}: {trial.algorithm}, {trial.steps:,} steps")
    torch.set_num_threads(1)
    for name in given.trials:
        for seed in given.seeds:
            run(name, seed, given.steps)
    if given.linear:
        write_linear()
    if given.draw:
        draw(read())


if __name__ == "__main__":
    print(f"drm-env {drm_env.__version__}", file=sys.stderr)
    main(sys.argv[1:])
