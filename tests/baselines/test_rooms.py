"""The rooms of drm_baselines: old addresses, seeds, and what an import costs."""

from __future__ import annotations

import importlib
import itertools
import pickle
import subprocess
import sys
import warnings

import pytest

import drm_baselines
from drm_baselines import _moved
from drm_baselines.errors import BaselineError
from drm_baselines.policies.gains import CONTROLLERS, TUNED
from drm_baselines.support import seeds
from drm_baselines.tuning.space import GAINS, SETTINGS


@pytest.mark.parametrize("old", sorted(_moved.MOVED))
def test_an_old_address_works_and_says_the_new_one(old: str) -> None:
    homes = [f"drm_baselines.{home}" for home in _moved.MOVED[old]]
    try:
        found = [importlib.import_module(home) for home in homes]
    except ModuleNotFoundError as error:
        if str(error.name).startswith("drm_baselines"):
            raise
        pytest.skip(f"{error.name} is not installed")
    sys.modules.pop(f"drm_baselines.{old}", None)
    with pytest.warns(DeprecationWarning, match=f"is now {homes[0]}"):
        module = importlib.import_module(f"drm_baselines.{old}")
    for home in found:
        for name, value in vars(home).items():
            if getattr(value, "__module__", None) == home.__name__ and not name.startswith("_"):
                assert getattr(module, name) is value
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        module.nonsense  # noqa: B018


def test_the_warning_points_at_the_import() -> None:
    sys.modules.pop("drm_baselines.metrics", None)
    with pytest.warns(DeprecationWarning, match=r"evaluation\.metrics") as caught:
        import drm_baselines.metrics  # noqa: F401
    assert [warning.filename for warning in caught] == [__file__]


def test_a_pickle_that_names_an_old_address_is_read() -> None:
    """Checkpoints of Stable-Baselines3 name the class of the policy."""
    asymmetric = pytest.importorskip("drm_baselines.rl.asymmetric")
    sys.modules.pop("drm_baselines.asymmetric", None)
    with pytest.warns(DeprecationWarning, match="rl.asymmetric"):
        found = pickle.loads(b"cdrm_baselines.asymmetric\nAsymmetricPolicy\n.")  # noqa: S301
    assert found is asymmetric.AsymmetricPolicy


def test_an_address_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match="nonsense"):
        importlib.import_module("drm_baselines.nonsense")


@pytest.mark.parametrize("package", ["drm_baselines", "drm_baselines.policies",
                                     "drm_baselines.evaluation"])  # fmt: skip
def test_a_package_exports_what_it_lists(package: str) -> None:
    module = importlib.import_module(package)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert all(getattr(module, name) is not None for name in module.__all__)


def test_old_names_of_policies_and_evaluation_are_there() -> None:
    from drm_baselines.evaluation import TRAINING_SEED, episode_seeds, fly_law, fly_policy
    from drm_baselines.policies import LAWS, TUNED, config_of, law_data, make_policy

    assert drm_baselines.make_policy is make_policy and drm_baselines.LAWS is LAWS
    assert TRAINING_SEED == seeds.TRAINING_SEED and episode_seeds is seeds.episode_seeds
    assert all(map(callable, (fly_law, fly_policy, config_of, law_data))) and "lqr" in TUNED


def test_a_policy_is_made_without_scipy_clarabel_or_torch() -> None:
    code = (
        "import sys, drm_baselines\n"
        "for name in ('lqr', 'linear_tuned', 'lyapunov', 'learned'):\n"
        "    drm_baselines.make_policy(name)\n"
        "print([name for name in ('scipy', 'clarabel', 'piqp', 'torch', 'optuna', 'matplotlib',\n"
        "                         'rich')\n"
        "       if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


def test_what_is_tuned_is_what_can_be_searched() -> None:
    assert tuple(TUNED.values()) == tuple(GAINS)
    assert tuple(SETTINGS) == CONTROLLERS


# --- seeds ----------------------------------------------------------------------------------------


def test_ranges_of_seeds_never_meet() -> None:
    for (one, first), (two, second) in itertools.combinations(seeds.RANGES.items(), 2):
        assert first.stop <= second.start or second.stop <= first.start, (one, two)


def test_everybody_draws_from_the_range_that_is_its_own() -> None:
    """The seeds that are drawn, as each room works them out."""
    from drm_baselines import suites
    from drm_baselines.imitation import dagger
    from drm_baselines.imitation.teacher import Teaching
    from drm_baselines.tuning.laws import training_scenarios

    ranges, training = seeds.RANGES, ("training", "training, seeds above 500")
    last = seeds.SUITE_SEED + 1_000_000 * len(suites.SUITES) - 1
    assert seeds.SUITE_SEED in ranges["suites"] and last in ranges["suites"]
    strata = len(suites.STRATA)
    last = dagger.IMITATION_CURVE_SEED + 1000 * (strata - 1) + dagger._CURVE_EPISODES - 1
    assert last in ranges["learning curves of imitation"]
    teaching = Teaching()
    assert teaching.first_seed in ranges["training"]
    last = teaching.first_seed + 100_000 * (strata - 1) + teaching.scenarios // strata - 1
    assert last in ranges["training"]
    for row in training_scenarios("robust", 400).strata:
        assert row["first_seed"] in ranges["tuning"]
        assert row["first_seed"] + row["count"] - 1 in ranges["tuning"]
    for run in (0, 9, 499, 501, 999):
        assert any(seeds.training_seed(run, 99) in ranges[name] for name in training)
    assert seeds.training_seed(3, 2) == 1_003_020_000


def test_a_training_on_the_seeds_of_tuning_is_refused() -> None:
    for run in (500, 1000):
        with pytest.raises(BaselineError, match=f"seed {run} of a training"):
            seeds.training_seed(run, 0)


def test_evaluations_stay_below_training() -> None:
    assert seeds.episode_seeds(seeds.TRAINING_SEED - 2, 2)[-1] == seeds.TRAINING_SEED - 1
    with pytest.raises(BaselineError, match="kept for training"):
        seeds.episode_seeds(seeds.TRAINING_SEED - 1, 2)
