"""Pictures: sizes, what they remember, that they change nothing, windows, grids and films."""

from __future__ import annotations

import copy
import itertools
import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers import vector as vector_wrappers
from numpy.typing import NDArray

import drm_env
from drm_env.constants import PALETTE

ID = "drm_env/Slew-v0"
VERMILION = tuple(bytes.fromhex(PALETTE["vermilion"][1:]))


def env_of(**options: Any) -> drm_env.DrmEnv:
    return drm_env.DrmEnv(**{"render_mode": "rgb_array", "mass_error": 0.15, **options})


def frame_of(env: drm_env.DrmEnv) -> NDArray[np.uint8]:
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    return frame


def flown(env: drm_env.DrmEnv, steps: int, action: tuple[float, float] = (0.3, -0.3)) -> None:
    for _ in range(steps):
        env.step(np.array(action, np.float32))


def count(frame: NDArray[np.uint8], colour: tuple[int, ...]) -> int:
    return int((frame == np.array(colour, np.uint8)).all(axis=2).sum())


# --- size and look --------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(640, 480), (800, 450), (1280, 720), (320, 240), (64, 64)])
def test_a_frame_has_the_size_asked_for(size: tuple[int, int]) -> None:
    env = env_of(render_width=size[0], render_height=size[1])
    env.reset(seed=0)
    frame = frame_of(env)
    assert frame.shape == (size[1], size[0], 3) and frame.dtype == np.uint8
    np.testing.assert_array_equal(frame, frame_of(env))


def test_the_size_survives_every_door() -> None:
    options: dict[str, Any] = {"render_width": 320, "render_height": 200}
    env = gym.make(ID, render_mode="rgb_array", **options)
    env.reset(seed=0)
    assert env.render().shape == (200, 320, 3)  # type: ignore[union-attr]  # other modes give text
    assert env.spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    again.reset(seed=0)
    assert again.render().shape == (200, 320, 3)  # type: ignore[union-attr]  # other modes give text
    vec = gym.make_vec(ID, num_envs=2, render_mode="rgb_array", **options)
    vec.reset(seed=0)
    assert [frame.shape for frame in vec.render() or ()] == [(200, 320, 3)] * 2
    assert drm_env.resolve(ID) == drm_env.resolve(env.spec)


BAD = {
    "no number": ({"render_width": "wide"}, "render_width.*'wide'"),
    "a fraction": ({"render_height": 99.5}, "render_height.*99.5"),
    "too small": ({"render_width": 3}, "render_width.*16.*3"),
    "too large": ({"render_height": 100_000}, "render_height.*4096.*100000"),
    "a flag": ({"render_width": True}, "render_width.*True"),
    "negative factor": ({"render_magnification": -2.0}, "render_magnification.*-2"),
    "no factor": ({"render_magnification": float("nan")}, "render_magnification.*nan"),
    "no title": ({"render_title": 3}, "render_title.*3"),
    "a name": ({"render_colour": "blue"}, "render_colour.*'blue'"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_look_names_field_and_value(name: str) -> None:
    options, match = BAD[name]
    for kind in (drm_env.DrmEnv, drm_env.DrmVectorEnv):
        with pytest.raises(drm_env.ConfigError, match=match):
            kind(**options)


def test_title_colour_and_factor_are_seen() -> None:
    frames = []
    for options in (
        {},
        {"render_title": "mine"},
        {"render_colour": PALETTE["purple"]},
        {"render_magnification": 1.0},
    ):
        env = env_of(**options)
        env.reset(seed=1)
        flown(env, 300)
        frames.append(frame_of(env))
    for first, second in itertools.combinations(frames, 2):
        assert (first != second).any()
    assert count(frames[2], tuple(bytes.fromhex(PALETTE["purple"][1:]))) > 500


def test_the_factor_stays_through_an_episode_and_follows_from_the_manoeuvre() -> None:
    """Slewing a hundred times slower bends about a hundred times less."""
    film = {}
    for acceleration in (2e-2, 2e-4):
        scenario = {"slew": {"angle": 0.01, "max_accel": acceleration}, "mass_error": 0.15}
        flight = drm_env.simulate(scenario, decimation=50)
        film[acceleration] = drm_env.Film(scenario, flight)
        other = drm_env.simulate(scenario, law="lyapunov", decimation=50)
        assert drm_env.Film(scenario, other).magnification == film[acceleration].magnification
    assert film[2e-4].magnification > 5.0 * film[2e-2].magnification


# --- what is remembered ---------------------------------------------------------------------------


def test_steps_have_the_same_bits_with_and_without_pictures() -> None:
    plain, drawn = env_of(render_mode=None), env_of()
    for env in (plain, drawn):
        env.reset(seed=5)
    generator = np.random.default_rng(0)
    for step in range(200):
        action = generator.uniform(-1.0, 1.0, 2).astype(np.float32)
        first, second = plain.step(action), drawn.step(action)
        if step % 20 == 0:
            drawn.render()
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:4] == second[1:4] and first[4] == second[4]
    assert plain.get_state() == drawn.get_state()


def test_curves_and_trail_begin_with_the_episode() -> None:
    env, fresh = env_of(), env_of()
    env.reset(seed=0)
    flown(env, 300)
    seen = frame_of(env)
    # another environment in the same state has not seen how it came there
    fresh.set_state(env.get_state())
    unseen = frame_of(fresh)
    assert (seen != unseen).any(axis=2).sum() > 100
    # and a new episode has forgotten the last
    first = env_of()
    first.reset(seed=1)
    env.reset(seed=1)
    np.testing.assert_array_equal(frame_of(env), frame_of(first))


def test_a_restored_state_is_drawn_from_its_own_time_on() -> None:
    env = env_of()
    env.reset(seed=0)
    flown(env, 200)
    state = env.get_state()
    flown(env, 200)
    env.set_state(state)
    fresh = env_of()
    fresh.set_state(state)
    np.testing.assert_array_equal(frame_of(env), frame_of(fresh))
    copies = (copy.deepcopy(env), pickle.loads(pickle.dumps(env)))  # noqa: S301
    for other in copies:
        np.testing.assert_array_equal(frame_of(other), frame_of(fresh))


def test_a_saturated_wheel_is_seen() -> None:
    env = env_of()
    env.reset(seed=0)
    flown(env, 1, (0.5, 0.5))
    assert count(frame_of(env), VERMILION) == 0
    flown(env, 1, (1.0, 0.5))
    assert count(frame_of(env), VERMILION) > 50


def test_an_arm_that_cannot_be_is_not_drawn() -> None:
    """A slew motor at its limit breaks the arm; the frame says so and holds the last picture."""
    env = env_of(task="slew_direct", limits={"slew_error": 1e9, "tip_deflection": 1e9})
    env.reset(seed=0)
    done, before, steps = False, frame_of(env), 0
    while not done:
        before = frame_of(env)
        sign = 1.0 if (steps // 8) % 2 == 0 else -1.0
        _, _, terminated, truncated, _ = env.step(np.array([sign, sign, sign], np.float32))
        done, steps = terminated or truncated, steps + 1
    assert terminated
    after = frame_of(env)
    assert count(after, VERMILION) > count(before, VERMILION) + 500
    assert (before == after).all(axis=2).mean() > 0.9


# --- batches --------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_frames_of_a_batch_are_those_of_single_environments(mode: str) -> None:
    options: dict[str, Any] = {"horizon": 0.2, "render_width": 320, "render_height": 240}
    vec = drm_env.DrmVectorEnv(3, render_mode="rgb_array", autoreset_mode=mode, **options)
    vec.reset(seed=0)
    single = drm_env.DrmEnv(render_mode="rgb_array", **options)
    single.reset(seed=1)
    action = np.array([0.2, -0.2], np.float32)
    for _ in range(30):
        vec.step(np.tile(action, (3, 1)))
        _, _, terminated, truncated, _ = single.step(action)
        if (terminated or truncated) and mode == "SameStep":
            single.reset()
        frames = vec.render()
        assert frames is not None
        np.testing.assert_array_equal(frames[1], frame_of(single))
        if (terminated or truncated) and mode == "NextStep":
            single.reset()
            vec.step(np.tile(action, (3, 1)))


def test_a_grid_shows_the_first_environments() -> None:
    vec = drm_env.DrmVectorEnv(20, render_mode="rgb_array", render_width=960, render_height=720)
    vec.reset(seed=0)
    vec.step(np.zeros((20, 2), np.float32))
    nine, sixteen = vec.render_grid(9), vec.render_grid()
    assert nine.shape == sixteen.shape == (720, 960, 3)
    assert (nine != sixteen).any()
    assert vec.render_grid(1).shape == (720, 960, 3)
    for most in (0, -1, 2.5):
        with pytest.raises(drm_env.ConfigError, match=rf"most.*{most}"):
            vec.render_grid(most)  # type: ignore[arg-type]  # the wrong type is the test
    with pytest.raises(drm_env.ConfigError, match=r"render_mode.*None"):
        drm_env.DrmVectorEnv(2).render_grid()
    with pytest.raises(drm_env.ResetNeededError):
        drm_env.DrmVectorEnv(2, render_mode="rgb_array").render_grid()


def test_a_batch_is_shown_in_a_window(capsys: pytest.CaptureFixture[str]) -> None:
    options: dict[str, Any] = {"render_width": 640, "render_height": 480, "horizon": 0.1}
    vec = gym.make_vec(ID, num_envs=4, render_mode="human", **options)
    vec.reset(seed=0)
    for _ in range(12):
        vec.step(np.zeros((4, 2), np.float32))
    assert vec.render() is None
    try:
        import pygame
    except ImportError:
        assert "O" in capsys.readouterr().out
    else:
        surface = pygame.display.get_surface()
        assert surface is not None and surface.get_size() == (640, 480)
        shown = pygame.surfarray.array3d(surface).swapaxes(0, 1)
        np.testing.assert_array_equal(shown, vec.unwrapped.render_grid())  # type: ignore[attr-defined]  # not of Gymnasium's base class
    vec.close()


def test_steps_of_a_batch_have_the_same_bits_with_and_without_pictures() -> None:
    batches = [drm_env.DrmVectorEnv(5, render_mode=mode) for mode in (None, "rgb_array")]
    for batch in batches:
        batch.reset(seed=3)
        for _ in range(50):
            batch.step(np.full((5, 2), 0.5, np.float32))
    assert batches[0].get_state() == batches[1].get_state()


# --- films and videos -----------------------------------------------------------------------------


def test_a_film_shows_what_the_environment_shows() -> None:
    """Apart from the reward, which a flight without a task does not have."""
    env = env_of(task="slew_thesis", render_width=320, render_height=240)
    env.reset(seed=0)
    rows = [env.signals()]
    for _ in range(500):
        env.step(np.array([0.1, 0.1], np.float32))
        rows.append(env.signals())
    trajectory = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    film = drm_env.Film(env.scenario(), trajectory, width=320, height=240)
    assert film.duration == pytest.approx(1.0)
    np.testing.assert_array_equal(film.frame(1.0), frame_of(env))


def test_films_beside_each_other_have_the_same_axes() -> None:
    scenario = {"mass_error": 0.15}
    flights = [drm_env.simulate(scenario, law=law, decimation=20) for law in ("none", "lyapunov")]
    films = [drm_env.Film(scenario, flight, width=640, height=480) for flight in flights]
    alone = films[1].frame(15.0)
    films[1].share_axes(films[0])
    assert (films[1].frame(15.0) != alone).any()
    # the same flight twice needs no other axes
    twice = [drm_env.Film(scenario, flights[1], width=640, height=480) for _ in range(2)]
    twice[0].share_axes(twice[1])
    np.testing.assert_array_equal(twice[0].frame(15.0), alone)


def test_frames_of_a_film_are_at_even_times() -> None:
    flight = drm_env.simulate({"horizon": 1.0, "slew": {"angle": 0.01}}, decimation=5)
    film = drm_env.Film({"horizon": 1.0, "slew": {"angle": 0.01}}, flight, width=64, height=64)
    frames = list(film.frames(fps=10, speed=0.5))
    assert len(frames) == 21
    np.testing.assert_array_equal(frames[10], film.frame(0.5))
    np.testing.assert_array_equal(frames[-1], film.frame(99.0))


def test_bad_films_are_refused() -> None:
    flight = drm_env.simulate({}, decimation=100)
    with pytest.raises(drm_env.ConfigError, match=r"^width.*7"):
        drm_env.Film({}, flight, width=7)
    with pytest.raises(drm_env.ConfigError, match=r"trajectory must have the signals alpha"):
        drm_env.Film({}, {name: flight[name] for name in flight if name != "alpha"})
    with pytest.raises(drm_env.ConfigError, match=r"one shape"):
        drm_env.Film({}, {**flight, "beta": np.zeros(3)})
    with pytest.raises(drm_env.ConfigError, match=r"not go back"):
        drm_env.Film({}, {**flight, "time": flight["time"][::-1]})
    with pytest.raises(drm_env.ConfigError, match=r"mass.*-1"):
        drm_env.Film({"payload": {"mass": -1.0}}, flight)
    film = drm_env.Film({}, flight, width=64, height=64)
    for arguments, match in (({"fps": 0.0}, "fps.*0"), ({"speed": -1.0}, "speed.*-1")):
        with pytest.raises(drm_env.ConfigError, match=match):
            next(film.frames(**arguments))


def test_gymnasium_records_a_video(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    imageio = pytest.importorskip("imageio.v3")
    options: dict[str, Any] = {"horizon": 0.2, "render_width": 320, "render_height": 240}
    env = RecordVideo(
        gym.make(ID, render_mode="rgb_array", **options), str(tmp_path / "one"), lambda _: True
    )
    env.reset(seed=0)
    done = False
    while not done:
        _, _, terminated, truncated, _ = env.step(np.zeros(2, np.float32))
        done = terminated or truncated
    env.close()
    (video,) = (tmp_path / "one").glob("*.mp4")
    assert imageio.imread(video, plugin="FFMPEG").shape == (21, 240, 320, 3)
    vec = vector_wrappers.RecordVideo(
        gym.make_vec(ID, num_envs=4, render_mode="rgb_array", **options),
        str(tmp_path / "many"),
        step_trigger=lambda step: step == 0,
        video_length=5,
    )
    vec.reset(seed=0)
    for _ in range(8):
        vec.step(np.zeros((4, 2), np.float32))
    vec.close()
    (video,) = (tmp_path / "many").glob("*.mp4")
    frames = imageio.imread(video, plugin="FFMPEG")
    assert frames.ndim == 4 and frames.shape[1] >= 480 and frames.shape[2] >= 640


def test_the_palette_is_that_of_okabe_and_ito() -> None:
    """https://jfly.uni-koeln.de/color, figure 16."""
    published = {
        "black": (0, 0, 0),
        "orange": (230, 159, 0),
        "sky blue": (86, 180, 233),
        "green": (0, 158, 115),
        "yellow": (240, 228, 66),
        "blue": (0, 114, 178),
        "vermilion": (213, 94, 0),
        "purple": (204, 121, 167),
    }
    for name, rgb in published.items():
        assert tuple(bytes.fromhex(PALETTE[name][1:])) == rgb
    assert set(PALETTE) == {*published, "grey"}
