"""Every public function is under a property test, or it is said why none applies."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

import drm_env
import drm_env.sb3

HERE = Path(__file__).parent
P = "test_properties.py::"
F = "test_function_properties.py::"
ANY = P + "test_any_configuration_flies_to_a_proper_end_or_is_refused_by_name"
SNAPSHOT = P + "test_a_snapshot_at_any_moment_goes_on_with_the_same_bits"
BATCH = P + "test_a_batch_has_the_bits_of_single_environments"
FORMS = F + "test_a_configuration_comes_back_from_every_form_of_it"
ROLLOUT = F + "test_a_rollout_has_the_metrics_and_signals_of_each_flight_alone"
DRAWS = F + "test_draws_stay_within_their_bounds_and_repeat"
MODELS = F + "test_models_have_symmetric_masses_positive_energies_and_rising_frequencies"
NETWORKS = F + "test_networks_act_within_bounds_and_as_numpy_does"
LAWS = F + "test_laws_of_many_are_the_laws_of_each"
FILMS = F + "test_pictures_have_the_size_that_was_asked_for"
DOORS = F + "test_the_doors_of_an_environment_say_the_same"
NONE = "reason: "
"""Begins the reason why no property test applies."""
PLAIN = NONE + "hands back what is held; tests/test_gymnasium_env.py and test_vector_env.py read it"
ERROR = NONE + "an exception class"
RECORD = NONE + "a tuple of numbers that another function fills"
PLANNED = NONE + "tests/test_planning.py holds it against closed forms and flights of drawn cases"
OLD = NONE + "an old name, which only warns; tests/test_vector_env.py"

COVERED: dict[str, str] = {
    "ArmPosition": RECORD,
    "Workspace": RECORD,
    "LegRecord": RECORD,
    "LoadEntry": RECORD,
    "SlewCandidate": RECORD,
    "SlewLimits": RECORD,
    "SlewMotion": RECORD,
    "SlewPlan": RECORD,
    "CheckError": ERROR,
    "InfeasibleError": ERROR,
    "LOAD_SYMBOLS": NONE + "a table of text",
    "load_signals": NONE + "a table of text; tests/test_loads.py holds it against the engine's",
    "DrmVectorEnv.ended_missions": NONE + "rows of what step has ended; tests/test_missions.py",
    "Rollout.to_frame": NONE + "hands numbers to pandas; tests/test_exports.py",
    "Rollout.to_mat": NONE + "hands numbers to SciPy; tests/test_exports.py",
    "Trajectory.to_frame": NONE + "hands numbers to pandas; tests/test_exports.py",
    "Trajectory.to_mat": NONE + "hands numbers to SciPy; tests/test_exports.py",
    "check_vector_env": NONE + "itself a test; tests/test_checking.py plants faults",
    "check_sb3_vec_env": NONE + "itself a test; tests/test_checking.py plants faults",
    "sb3.native_batch": NONE + "makes a batch; tests/test_sb3_adapter.py has its bits",
    "SlewCandidate.to_dict": PLANNED,
    "SlewCandidate.value": PLANNED,
    "SlewLimits.given": PLANNED,
    "SlewLimits.of": PLANNED,
    "SlewPlan.tip_path": PLANNED,
    "SlewPlan.to_dict": PLANNED,
    "inverse_kinematics": PLANNED,
    "plan_slew": PLANNED,
    "slew_acceleration": PLANNED,
    "slew_demands": PLANNED,
    "slew_final_time": PLANNED,
    "slew_motion": PLANNED,
    "tip_position": PLANNED,
    "workspace": PLANNED,
    "METRIC_SYMBOLS": NONE + "a table of text",
    "NO_VALUE": NONE + "a constant",
    "ActionError": ERROR, "ActionTypeError": ERROR, "ConfigError": ERROR, "DrmError": ERROR,
    "EnvironmentClosedError": ERROR, "ResetNeededError": ERROR, "SimulationError": ERROR,
    "SnapshotError": ERROR, "UnknownOptionError": ERROR,
    "MetricEntry": RECORD, "ObservationEntry": RECORD, "Transitions": RECORD,
    "EnvConfig": FORMS, "Scenario": FORMS, "Task": FORMS,
    "Choices": DRAWS, "LogUniform": DRAWS, "Normal": DRAWS, "Uniform": DRAWS,
    "DrmEnv": ANY,
    "DrmEnv.reset": P + "test_a_seed_of_any_size_is_repeatable_or_refused",
    "DrmEnv.step": ANY,
    "DrmEnv.close": ANY,
    "DrmEnv.render": NONE + "tests/test_pictures.py draws every mode of every environment",
    "DrmEnv.set_wrapper_attr": NONE + "tests/test_options_at_every_door.py has each option",
    "DrmEnv.get_state": SNAPSHOT, "DrmEnv.set_state": SNAPSHOT,
    "DrmEnv.set_context": DOORS, "DrmEnv.signals": DOORS, "DrmEnv.scenario": DOORS,
    "DrmEnv.clone": DOORS,
    "DrmVectorEnv": BATCH, "DrmVectorEnv.reset": BATCH, "DrmVectorEnv.step": BATCH,
    "DrmVectorEnv.advance": NONE + "the inner half of step, which is under " + BATCH,
    "DrmVectorEnv.ended": NONE + "rows of what step has ended; tests/test_infos.py",
    "DrmVectorEnv.reset_envs": DOORS, "DrmVectorEnv.reset_lanes": OLD,
    "DrmVectorEnv.set_context": DOORS,
    "DrmVectorEnv.get_state": P + "test_any_array_is_flown_as_the_numbers_in_it_or_refused",
    "DrmVectorEnv.set_state": NONE + "tests/test_snapshots.py damages every byte of one",
    "DrmVectorEnv.render": NONE + "tests/test_pictures.py",
    "DrmVectorEnv.render_grid": NONE + "tests/test_pictures.py",
    "DrmVectorEnv.frame_of": NONE + "tests/test_pictures.py",
    "DrmVectorEnv.close_extras": NONE + "called by close; tests/test_vector_env.py",
    "DrmVectorEnv.call": PLAIN, "DrmVectorEnv.get_attr": PLAIN, "DrmVectorEnv.set_attr": PLAIN,
    "ControlLaw": LAWS, "ControlLaw.initial_state": LAWS, "ControlLaw.measurements": LAWS,
    "ControlLaw.torques": LAWS,
    "Film": FILMS, "Film.share_axes": FILMS, "Film.frame": FILMS, "Film.frames": FILMS,
    "Model": MODELS, "Model.matrices": MODELS, "Model.acceleration": MODELS,
    "Model.energy": MODELS, "Model.angular_momentum": MODELS,
    "Model.natural_frequencies": MODELS, "Model.mode_shapes": MODELS, "Model.linearize": MODELS,
    "Model.spatial_modes": MODELS, "Model.mode_kinds": MODELS,
    "Network": NETWORKS,
    "ResolvedConfig": FORMS, "ResolvedConfig.from_json": FORMS, "ResolvedConfig.to_json": FORMS,
    "ResolvedConfig.to_dict": FORMS,
    "ResolvedConfig.identification_slopes": NONE + "held against differences of what is shown "
    "by tests/test_agent_options.py and tests/baselines/imitation",
    "Rollout": ROLLOUT, "Rollout.trajectory": ROLLOUT, "Trajectory": ROLLOUT,
    "rollout": ROLLOUT, "simulate": ROLLOUT, "episode_metrics": ROLLOUT,
    "default_config": FORMS, "observation_layout": FORMS, "option_names": FORMS,
    "info_metrics": DOORS,
    "resolve": P + "test_a_value_that_is_none_is_refused_by_its_name",
    "sample_scenarios": F
    + "test_sampled_scenarios_are_what_environments_fly_and_within_their_distributions",
    "transitions": F + "test_transitions_have_finite_matrices_that_follow_each_other",
    "sb3.make_sb3_vec": DOORS, "sb3.DrmSB3VecEnv": DOORS,
}  # fmt: skip


def public_names() -> set[str]:
    """Return the public names, and of each class those of its own methods."""
    found = {"sb3." + name for name in drm_env.sb3.__all__}
    for name in drm_env.__all__:
        if name.startswith("__"):
            continue
        found.add(name)
        thing = getattr(drm_env, name)
        if not inspect.isclass(thing) or not thing.__module__.startswith("drm_env."):
            continue
        if thing.__module__.endswith("_config"):
            continue  # data classes, generated
        for member, value in vars(thing).items():
            function = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
            if not member.startswith("_") and inspect.isfunction(function):
                found.add(f"{name}.{member}")
    return found


def test_every_public_name_is_listed() -> None:
    names = public_names()
    missing = sorted(names - set(COVERED))
    assert not missing, (
        f"give these a property test, or a reason, in {Path(__file__).name}: {missing}"
    )
    assert sorted(set(COVERED) - names) == []


@pytest.mark.parametrize("name", [name for name in COVERED if not COVERED[name].startswith(NONE)])
def test_the_property_test_is_there_and_uses_the_name(name: str) -> None:
    file, _, test = COVERED[name].partition("::")
    text = (HERE / file).read_text()
    at = text.find(f"def {test}(")
    assert at >= 0, f"there is no {test} in {file}"
    decorated = max(text.rfind("\n\n\n", 0, at), 0)
    body = text[decorated : text.find("\n\n\n", at)]
    thing = drm_env.sb3 if name.startswith("sb3.") else getattr(drm_env, name.partition(".")[0])
    if (inspect.isclass(thing) and "." not in name) or name == "sb3.DrmSB3VecEnv":
        return  # what other functions make
    word = name.rpartition(".")[2]
    assert word in body, f"{test} does not use {word}"
