"""What has to be installed: policies fly with little, and what is missing is named with its extra.

Packages are taken away by a finder that knows the standard library and a list of names, and says
of everything else what Python says of what is not installed.
"""

from __future__ import annotations

import importlib.metadata
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from drm_baselines.errors import BaselineError, MissingPackageError
from drm_baselines.support import extras

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "baselines" / "pyproject.toml").read_text())["project"]


def modules_of(*distributions: str) -> tuple[str, ...]:
    """Return what installing distributions brings: their modules and those that they need."""
    brought: dict[str, set[str]] = {}
    for module, names in importlib.metadata.packages_distributions().items():
        for name in names:
            brought.setdefault(canonicalize_name(name), set()).add(module)
    found: set[str] = set()
    seen: set[str] = set()
    waiting = list(map(canonicalize_name, distributions))
    while waiting:
        name = waiting.pop()
        if name in seen or name not in brought:
            continue
        seen.add(name)
        found |= brought[name]
        for text in importlib.metadata.requires(name) or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(canonicalize_name(requirement.name))
    return tuple(sorted(found))


ENVIRONMENT_MODULES = ("drm_env", *modules_of("gymnasium", "numpy"))
BASE = ("drm_baselines", *ENVIRONMENT_MODULES, "safetensors")
CLI = (*BASE, *modules_of("filelock", "platformdirs", "rich", "typer"))

WITH = """
import sys

class Only:
    names = {names!r}

    def find_spec(self, name, path=None, target=None):
        root = name.partition(".")[0]
        known = root in self.names or root in sys.stdlib_module_names
        if not known and not root.startswith("_sysconfigdata"):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Only())
"""


def python(
    program: str, *arguments: object, names: tuple[str, ...]
) -> subprocess.CompletedProcess[str]:
    """Run a program in a process in which nothing can be imported but ``names``."""
    command = [sys.executable, "-c", WITH.format(names=names) + program]
    return subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, check=False
    )


def drm(*arguments: object, names: tuple[str, ...] = CLI) -> subprocess.CompletedProcess[str]:
    return python("from drm_baselines.cli import main\nmain()", *arguments, names=names)


# --- the little that is enough --------------------------------------------------------------------


def distribution(requirement: str) -> str:
    return requirement.partition(">")[0].partition("[")[0]


def test_nothing_else_is_required() -> None:
    environment = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {distribution(each) for each in environment["dependencies"]} == {"gymnasium", "numpy"}
    needed = {distribution(each) for each in PROJECT["dependencies"]}
    assert needed == {"drm-env", "gymnasium", "numpy", "safetensors"}


EPISODES = """
import gymnasium as gym
import drm_env
from drm_baselines import make_policy
from drm_baselines.policies import save_policy

def fly(policy, env):
    observation, info = env.reset(seed=3)
    state, start, ended = None, [True], False
    while not ended:
        action, state = policy.predict(observation, state, start)
        observation, reward, terminated, truncated, info = env.step(action)
        ended, start = terminated or truncated, [False]
    return info["metrics/tip_error_rms"]

options = {"horizon": 1.0, "slew_angle": 0.01}
for name in ("none", "linear", "lyapunov", "linear_tuned", "lyapunov_tuned", "lqr"):
    env = gym.make("drm_env/Slew-v0", control_period=0.002, **options)
    assert fly(make_policy(name, env=env), env) >= 0.0
learned = make_policy("learned")
env = gym.make(learned.env_id, config=learned.config, horizon=1.0, slew_angle=0.01)
assert fly(make_policy("learned", env=env), env) >= 0.0
foreign = {name.partition(".")[0] for name in sys.modules} - sys.stdlib_module_names
print(sorted(foreign & {"torch", "scipy", "matplotlib", "rich", "typer"}))
"""


def test_every_policy_flies_an_episode_with_nothing_else() -> None:
    done = python(EPISODES, names=BASE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


ENVIRONMENT = """
import gymnasium as gym
import drm_env
env = gym.make("drm_env/Slew-v0", render_mode="rgb_array")
env.reset(seed=0)
env.step(env.action_space.sample())
assert env.render().ndim == 3
vec = gym.make_vec("drm_env/Slew-v0", num_envs=4)
vec.reset(seed=0)
vec.step(vec.action_space.sample())
drm_env.simulate(law="linear")
drm_env.rollout(drm_env.sample_scenarios("slew", seed=0, n=2), law="linear")
drm_env.Model().natural_frequencies(8.0)
try:
    import drm_env.sb3
except ModuleNotFoundError as error:
    print(error)
"""


def test_the_environment_needs_gymnasium_and_numpy_alone() -> None:
    done = python(ENVIRONMENT, names=ENVIRONMENT_MODULES)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("python -m pip install stable-baselines3")


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        ("benchmark", "--help"),
        ("info",),
        ("info", "--options"),
        ("info", "--json"),
        ("modes", "--extension", 4),
        ("simulate", "--law", "linear"),
        ("bench", "--list"),
    ],
    ids=lambda arguments: " ".join(map(str, arguments)),
)
def test_light_commands_need_the_extra_cli_alone(arguments: tuple[object, ...]) -> None:
    done = drm(*arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout and not done.stderr


def refused(done: subprocess.CompletedProcess[str], extra: str) -> str:
    """Check that a command has said in one line which extra it needs; return the line."""
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("error: "), done.stderr
    assert f"the extra '{extra}' installs" in done.stderr
    assert f"[{extra}]" in shlex.split(done.stderr.split("Install it with: ")[1])[-1]
    return done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra", "packages"),
    [
        (("modes", "--plot", "OUT"), "plot", "matplotlib"),
        (("simulate", "--out", "OUT"), "plot", "matplotlib"),
        (("compare",), "evaluate", "scipy"),
        (("compare", "--out", "OUT"), "evaluate", "scipy and matplotlib"),
        (("evaluate", "--policy", "linear", "--out", "OUT"), "evaluate", "scipy"),
        (("train", "--out", "OUT"), "learn", "scipy, stable_baselines3 and torch"),
        (("imitate", "--out", "OUT"), "learn", "clarabel, piqp, scipy and torch"),
        (("tune", "lqr", "--out", "OUT"), "tune", "clarabel, optuna, piqp and scipy"),
        (
            ("benchmark", "--out", "OUT"),
            "report",
            "jinja2, matplotlib, scipy, clarabel, piqp and pyarrow",
        ),
        (("sweep", "--out", "OUT"), "report", "matplotlib, pyarrow and scipy"),
        (
            ("train", "--seeds", "0-1", "--out", "OUT"),
            "learn",
            "scipy, stable_baselines3 and torch",
        ),
        (("demo", "--out", "OUT"), "evaluate", "jinja2, matplotlib and scipy"),
        (("demo", "--train", "--out", "OUT"), "learn", "torch"),
        (("reproduce", "--out", "OUT"), "evaluate", "matplotlib and scipy"),
        (("bench", "--only", "kernel", "--out", "OUT"), "bench", "matplotlib"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_a_command_names_the_extra_before_it_does_anything(
    tmp_path: Path, arguments: tuple[str, ...], extra: str, packages: str
) -> None:
    out = tmp_path / "out"
    given = [str(out) if each == "OUT" else each for each in arguments]
    line = refused(drm(*given), extra)
    assert f"needs {packages}, " in line or f"{packages}, which" in line
    assert not out.exists()


def test_a_cluster_names_its_extra(tmp_path: Path) -> None:
    names = (*CLI, "clarabel", "jinja2", "matplotlib", "piqp", "pyarrow", "scipy")
    for command in ("sweep", "benchmark"):
        done = drm(command, "--ray", "--out", tmp_path / "out", names=names)
        assert "needs ray, which" in refused(done, "scale")
    assert not (tmp_path / "out").exists()


def test_parquet_names_its_extra_and_csv_needs_none(tmp_path: Path) -> None:
    names = (*CLI, "scipy")
    path = tmp_path / "records"
    given = ("evaluate", "--policy", "none", "--episodes", 2, "--records")
    refused(drm(*given, path.with_suffix(".parquet"), names=names), "report")
    done = drm(*given, path.with_suffix(".csv"), names=names)
    assert done.returncode == 0, done.stderr


def test_the_command_itself_names_its_extra() -> None:
    line = refused(drm("--help", names=BASE), "cli")
    assert "needs filelock, platformdirs, rich and typer" in line


def test_what_no_command_asked_for_is_named_all_the_same() -> None:
    """Found missing in the middle of something, a package is one line too."""
    program = (
        "from drm_baselines.cli.common import ending_well\n"
        "def work():\n"
        "    import scipy.signal\n"
        "ending_well(work)\n"
    )
    done = python(f"import typer\ntry:\n    exec({program!r})\nexcept typer.Exit as end:\n"
                  "    sys.exit(end.exit_code)\n", names=CLI)  # fmt: skip
    refused(done, "evaluate")


# --- the rooms of the package ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("room", "extra"),
    [
        ("optimal_control.lower_bound", "plan"),
        ("imitation.student", "learn"),
        ("benchmark.report.page", "report"),
        ("thesis", "evaluate"),
        ("rl.training", "learn"),
        ("rl.export", "learn"),
        ("evaluation.plots", "plot"),
        ("evaluation.tables", "cli"),
        ("speed.reference.with_numba", "bench"),
    ],
)
def test_a_room_names_the_extra_at_its_door(room: str, extra: str) -> None:
    program = (
        "from drm_baselines.errors import MissingPackageError\n"
        f"try:\n    import drm_baselines.{room}\n"
        "except MissingPackageError as error:\n    print(error.extra, error.name)\n"
    )
    done = python(program, names=BASE)
    assert done.returncode == 0, done.stderr
    found, package = done.stdout.split()
    assert found == extra and package in extras.EXTRAS[extra]


# --- the table and the message --------------------------------------------------------------------


def installs(extra: str) -> set[str]:
    """Return the distributions that an extra of ``pyproject.toml`` installs."""
    found = set()
    for requirement in PROJECT["optional-dependencies"][extra]:
        if requirement.startswith("drm-baselines["):
            for other in requirement.removeprefix("drm-baselines[").removesuffix("]").split(","):
                found |= installs(other)
        else:
            found.add(distribution(requirement))
    return found


@pytest.mark.parametrize("extra", extras.EXTRAS)
def test_the_table_of_extras_is_what_is_installed(extra: str) -> None:
    assert {name.replace("_", "-") for name in extras.EXTRAS[extra]} == installs(extra)


def test_all_means_all() -> None:
    assert installs("all") == set().union(*map(installs, extras.EXTRAS))
    assert {*extras.EXTRAS, "all"} == set(PROJECT["optional-dependencies"])


def test_a_package_is_looked_for_in_the_smallest_extra() -> None:
    found = {name: extras.extra_of(name) for name in ("matplotlib.figure", "scipy", "torch.nn")}
    assert found == {"matplotlib.figure": "plot", "scipy": "evaluate", "torch.nn": "learn"}
    assert extras.extra_of("nonsense") is None


def test_the_command_in_the_message_works() -> None:
    error = MissingPackageError("training", "learn", ["stable_baselines3", "torch"])
    assert isinstance(error, BaselineError) and isinstance(error, ModuleNotFoundError)
    assert error.name == "stable_baselines3"
    words = shlex.split(str(error).split("Install it with: ")[1])
    assert words[:5] == ["python", "-m", "pip", "install", "-e"]
    place, extra = words[5].removesuffix("]").split("[")
    assert Path(place).resolve() == ROOT / "baselines"
    assert extra in PROJECT["optional-dependencies"]


def test_a_package_that_cannot_be_loaded_says_why() -> None:
    with (
        pytest.raises(MissingPackageError, match=r"needs torch \(no libcuda\), which the extra"),
        extras.needing("training"),
    ):
        raise ImportError("no libcuda", name="torch._C")


def test_a_module_of_nobody_is_no_matter_of_extras() -> None:
    with pytest.raises(ModuleNotFoundError, match="nonsense") as caught, extras.needing("this"):
        import nonsense  # noqa: F401
    assert not isinstance(caught.value, MissingPackageError)
