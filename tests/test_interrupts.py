"""Ctrl-C ends every long native call, with KeyboardInterrupt and nothing half changed."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs signals of POSIX")

BOUND = 3.0
"""Seconds within which a call must have ended; it does within one on an idle machine."""

HEAD = """
import os, signal, sys, threading, time
import numpy as np
import drm_env
from drm_env import _engine

sent = []

def interrupt_after(seconds):
    def send():
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)
    threading.Timer(seconds, send).start()

def interrupted(call, seconds=0.4):
    interrupt_after(seconds)
    try:
        call()
    except KeyboardInterrupt:
        print("interrupted after", time.perf_counter() - sent[-1], flush=True)
        return
    print("not interrupted", flush=True)

SLOW = {"plant": "consistent", "modes": [8, 8], "integrator_step": 1e-6, "horizon": 2000.0}
"""

TAIL = "\nos._exit(0)\n"  # what still runs in other threads need not end


def run(script: str, timeout: float = 120.0) -> str:
    text = HEAD + textwrap.dedent(script) + TAIL
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=timeout, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "panicked" not in done.stderr, done.stderr
    return done.stdout


def assert_interrupted(output: str) -> None:
    for line in output.splitlines()[:1]:
        assert line.startswith("interrupted after"), output
        assert float(line.split()[-1]) < BOUND, output
    assert output, "nothing was printed"


CALLS = {
    "simulate": "drm_env.simulate(SLOW, decimation=1000)",
    "simulate the thesis plant": "drm_env.simulate({'horizon': 20000.0}, decimation=1000)",
    "transitions": "drm_env.transitions({**SLOW, 'horizon': 20.0})",
    "rollout": "drm_env.rollout([SLOW] * 4, 'linear')",
    "rollout of samples that take long": (
        "drm_env.rollout([{**SLOW, 'integrator_step': 3e-8}] * 4, 'linear')"
    ),
    "rollout of a callable law": (
        "drm_env.rollout([SLOW] * 4, lambda seen: np.zeros((4, 2)), law_period=1.0)"
    ),
    "rollout of missions under a callable law": (
        "drm_env.rollout([{'scenario': {**SLOW, 'horizon': 2100.0}, 'mission': {'legs': ["
        "{'kind': 'slew', 'angle': 0.5, 'duration': 2000.0}]}}] * 4, "
        "lambda seen: np.zeros((4, 2)), law_period=1.0)"
    ),
    "rollout with loads": "drm_env.rollout([SLOW] * 4, 'linear', loads=True)",
    "rollout under torques": (
        "drm_env.rollout([SLOW] * 4, torques=np.ones((4, 3, 2)), signals=['alpha'], decimation=99)"
    ),
    "kernel benchmark": "_engine.kernel_benchmark(1, 10**15)",
    "environment benchmark": ("_engine.env_benchmark(_engine.Config('slew', None, None), 10**12)"),
    "batch benchmark": (
        "_engine.batch_benchmark(_engine.Config('slew', None, None), 64, 10**12, 2)"
    ),
    "scenarios": (
        "_engine.sample_scenarios(_engine.Config('slew', None, None), [b'1'] * 2_000_000)"
    ),
}


CALLS["making a batch"] = (
    "_engine.Batch(_engine.Config('slew', None, None), 400_000, 'next_step', None, None)"
)

ENDED = {
    "Batch", "Batch.reset", "Batch.step", "Batch.get_state", "Batch.set_state", "Env.step",
    "Network.act", "batch_benchmark", "env_benchmark", "kernel_benchmark", "rollout",
    "rollout_asked",
    "sample_scenarios", "simulate", "transitions",
}  # fmt: skip
"""Calls that the tests of this file interrupt."""
SHORT = {
    # a number, a name, or a copy of what is there, as long as its result
    "Batch": "action_size began_contexts contexts coordinates diverged env_state final_obs "
    "has_reset horizon_steps legs metrics mission_reports observation_size observations "
    "reset_happened signals success",
    "Config": "action_size context control_period drawn horizon horizon_steps "
    "identification_slopes mission_legs observation_layout sample_period to_json",
    "Env": "action_size context get_state has_reset horizon_steps legs mission_report "
    "observation_size report scenario_json signals steps",
    "Law": "control_period needs_tip_rate torque_limits", "Network": "inputs outputs",
    "": "check_memory context_names distribution_names film_signals fine_scales instructions "
    "law_names load load_names measured_names measurement_names metric_names option_names_json "
    "palette panic_after_parts payload_inertias prescribed reward_names schema_json signal_names "
    "table_2_7 task_names Config Env Law Model Network",
}  # fmt: skip
ONE_EPISODE = {
    # the work of one environment, one draw or one extension of the arm: milliseconds
    "Batch": "render_ansi set_context set_env_context set_env_state",
    "Env": "render_ansi reset set_context set_state",
    "Law": "torques",
    # a picture, the largest in less than a second; many look for a signal between two
    "Painter": "follow follow_batch frame frame_of grid",
    "": "Painter Film",
    "Film": "frame magnification ranges widen",
    "Model": "acceleration angular_momentum energy linearize matrices mode_shapes "
    "natural_frequencies spatial_modes",
}


def test_every_call_of_the_engine_is_interrupted_or_said_to_be_short() -> None:
    from drm_env import _engine

    found = set()
    for name, thing in vars(_engine).items():
        if name.startswith("_") or not callable(thing):
            continue
        found.add(name)
        if isinstance(thing, type):
            found |= {f"{name}.{each}" for each in vars(thing) if not each.startswith("_")}
    listed = set(ENDED)
    for table in (SHORT, ONE_EPISODE):
        for kind, names in table.items():
            listed |= {f"{kind}.{name}".lstrip(".") for name in names.split()}
    assert found - listed == set(), "new calls"
    assert listed - found == set(), "calls that there are no more"


def test_a_snapshot_of_many_environments_ends() -> None:
    script = """
        env = drm_env.DrmVectorEnv(100_000)
        env.reset(seed=0)
        state = env.get_state()
        interrupted(lambda: CALL, 0.1)
        try:
            print(env.get_state() == state, flush=True)
        except drm_env.SimulationError as error:
            print("unusable" in str(error), flush=True)
    """
    for call in ("env.get_state()", "env.set_state(state)"):
        output = run(script.replace("CALL", call))
        assert_interrupted(output)
        assert output.splitlines()[1] == "True", "whole, or said to be unusable"


@pytest.mark.parametrize("name", CALLS)
def test_a_long_call_ends(name: str) -> None:
    assert_interrupted(run(f"interrupted(lambda: {CALLS[name]})"))


def test_a_network_ends_its_rollout_and_its_rows() -> None:
    made = """
        layer = (np.zeros((2, 35), np.float32), np.zeros(2, np.float32))
        policy = drm_env.Network([layer])
        options = {key: value for key, value in SLOW.items() if key != "modes"}
    """
    call = "drm_env.rollout([SLOW] * 4, policy=policy, config={'scenario': SLOW})"
    assert_interrupted(run(textwrap.dedent(made) + f"interrupted(lambda: {call})"))
    wide = """
        wide = np.zeros((4096, 4096), np.float32)
        policy = drm_env.Network([(wide, wide[0])] * 4)
        rows = np.zeros((2000, 4096), np.float32)
        interrupted(lambda: policy(rows))
    """
    assert_interrupted(run(wide))


def test_an_interrupted_reset_that_has_drawn_alone_changes_nothing() -> None:
    output = run(
        """
        big = drm_env.DrmVectorEnv(150_000)
        seeds, texts = [b"1"] * 150_000, ['{"payload_mass": 320.0}'] * 150_000
        out = np.zeros((150_000, big._observation_size), np.float32)
        interrupted(lambda: big._engine.reset(seeds, texts, None, out), 0.15)
        print(big._engine.has_reset(), flush=True)
        """
    )
    assert_interrupted(output)
    assert output.splitlines()[1] == "False"


def test_a_step_that_is_stopped_half_way_leaves_a_batch_that_says_so() -> None:
    output = run(
        """
        config = {"scenario": {**SLOW, "horizon": 20.0}, "task": {"control_period": 20.0}}
        env = drm_env.DrmVectorEnv(16, config=config)
        env.reset(seed=0)
        interrupted(lambda: env.step(np.zeros((16, 2), np.float32)))
        for call in (
            lambda: env.step(np.zeros((16, 2), np.float32)),
            lambda: env.reset(seed=0),
            lambda: env.get_state(),
        ):
            try:
                call()
            except drm_env.SimulationError as error:
                print(error, flush=True)
        env.close()
        """
    )
    assert_interrupted(output)
    assert output.count("unusable, for an earlier call was interrupted half-way") == 3


def test_a_single_step_ends() -> None:
    output = run(
        """
        config = {"scenario": {**SLOW, "horizon": 20.0}, "task": {"control_period": 20.0}}
        env = drm_env.DrmEnv(config=config)
        env.reset(seed=0)
        interrupted(lambda: env.step(np.zeros(2, np.float32)))
        try:
            env.step(np.zeros(2, np.float32))
        except drm_env.SimulationError as error:
            print(error, flush=True)
        """
    )
    assert_interrupted(output)
    assert "unusable" in output


def test_a_step_that_ends_in_time_is_whole() -> None:
    """The interruption comes in the midst of a step of a third of a second; it is a whole step."""
    output = run(
        """
        def made():
            config = {"scenario": {"horizon": 1600.0}, "task": {"control_period": 400.0}}
            env = drm_env.DrmVectorEnv(8, config=config, num_threads=1)
            env.reset(seed=0)
            return env
        actions = np.zeros((8, 2), np.float32)
        env, other = made(), made()
        begin = time.perf_counter()
        env.step(actions)
        lasts = time.perf_counter() - begin
        interrupted(lambda: other.step(actions), lasts / 2)
        print(lasts, env.get_state() == other.get_state(), flush=True)
        """
    )
    assert_interrupted(output)
    lasts, same = output.splitlines()[1].split()
    if float(lasts) > 0.8:
        pytest.skip(f"a step takes {lasts} s here, too long to be let come to its end")
    assert same == "True"


def test_waiting_for_another_thread_ends() -> None:
    output = run(
        """
        config = {"scenario": {**SLOW, "horizon": 20.0}, "task": {"control_period": 20.0}}
        env = drm_env.DrmVectorEnv(16, config=config)
        env.reset(seed=0)
        actions = np.zeros((16, 2), np.float32)
        threading.Thread(target=lambda: env.step(actions), daemon=True).start()
        time.sleep(0.3)
        interrupted(lambda: env.get_state())
        """
    )
    assert_interrupted(output)


def test_the_handler_of_a_signal_that_uses_the_same_batch_is_told_so() -> None:
    output = run(
        """
        config = {"scenario": {**SLOW, "horizon": 20.0}, "task": {"control_period": 20.0}}
        env = drm_env.DrmVectorEnv(16, config=config)
        env.reset(seed=0)
        def handler(number, frame):
            try:
                env.get_state()
            except drm_env.SimulationError as error:
                print("interrupted after", 0.0, error, 0.0, flush=True)
            raise KeyboardInterrupt
        signal.signal(signal.SIGINT, handler)
        interrupted(lambda: env.step(np.zeros((16, 2), np.float32)))
        """
    )
    assert "busy with the call during which" in output
    assert "interrupted after" in output.splitlines()[-1]


def test_a_handler_that_returns_lets_the_call_go_on() -> None:
    output = run(
        """
        called = []
        signal.signal(signal.SIGINT, lambda number, frame: called.append(time.perf_counter()))
        interrupt_after(0.2)
        flown = drm_env.simulate({"horizon": 2000.0}, decimation=1000)
        print(len(called), len(flown["time"]), flush=True)
        """
    )
    assert output.split() == ["1", "1001"]
