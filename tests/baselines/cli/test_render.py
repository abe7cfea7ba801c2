"""``drm render``: films of policies side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drm_baselines.cli import app
from drm_baselines.policies.names import POLICIES

imageio = pytest.importorskip("imageio.v3")
pytest.importorskip("imageio_ffmpeg")

SMALL = ("--set", "horizon=0.5", "--fps", "10")


def drm(*arguments: str | Path | float) -> Result:
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def refused(*arguments: str | Path | float) -> str:
    result = drm(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    return " ".join(result.stderr.split())


@pytest.mark.parametrize("ending", ["mp4", "gif", "GIF"])
def test_a_film_has_its_pictures_and_its_size(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"film.{ending}"
    result = drm("-o", path, "--width", 482, "--height", 241, *SMALL)
    assert result.exit_code == 0, result.output + result.stderr
    assert str(path) in result.stdout
    plugin = "FFMPEG" if ending == "mp4" else "pillow"
    frames = imageio.imread(path, plugin=plugin)
    # sides of MP4 are even
    height = 242 if ending == "mp4" else 241
    assert frames.shape == (6, height, 482, 3)
    assert (frames[0] != frames[-1]).any()
    # nothing temporary is left
    assert list(tmp_path.iterdir()) == [path]


def test_policies_have_their_colours_beside_each_other(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    names = ("none", "linear", "dagger")
    policies = [word for name in names for word in ("--policy", name)]
    result = drm("-o", path, *policies, "--width", 1440, "--height", 560, *SMALL)
    assert result.exit_code == 0, result.output + result.stderr
    last = imageio.imread(path, plugin="pillow")[-1].astype(int)
    for index, name in enumerate(names):
        colour = np.array(list(bytes.fromhex(POLICIES[name].colour[1:])))
        part = last[:, 480 * index : 480 * (index + 1)]
        # a GIF has few colours, but near ones
        assert (np.abs(part - colour).max(axis=2) <= 12).sum() > 200, name


def test_the_name_of_a_task_is_an_environment(tmp_path: Path) -> None:
    film = ("--policy", "none", "--width", 64, "--height", 64, "--fps", 2, "--duration", 1)
    for name in ("slew_thesis", "drm_env/SlewThesis-v0"):
        path = tmp_path / f"{name[-4:]}.gif"
        result = drm("-o", path, "--env", name, *film)
        assert result.exit_code == 0, result.stderr
    first, second = sorted(tmp_path.iterdir())
    assert first.read_bytes() == second.read_bytes()


def test_what_cannot_be_made_is_refused_before_anything_is_flown(tmp_path: Path) -> None:
    there = tmp_path / "there.gif"
    there.write_bytes(b"mine")
    assert "--force" in refused("-o", there)
    assert there.read_bytes() == b"mine"
    assert ".mp4 or .gif" in refused("-o", tmp_path / "film.avi")
    assert "no policy 'lyapunow'" in refused("-o", tmp_path / "a.gif", "--policy", "lyapunow")
    assert "no environment 'Slew'" in refused("-o", tmp_path / "a.gif", "--env", "Slew")
    assert "payload_weight" in refused("-o", tmp_path / "a.gif", "--set", "payload_weight=3")
    assert "--fps" in refused("-o", tmp_path / "a.gif", "--fps", 0)
    many = [word for _ in range(13) for word in ("--policy", "none")]
    assert "at most 12" in refused("-o", tmp_path / "a.gif", *many)
    assert list(tmp_path.iterdir()) == [there]


def test_an_existing_film_is_replaced_when_asked(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    path.write_bytes(b"old")
    result = drm("-o", path, "--force", "--width", 64, "--height", 64, *SMALL)
    assert result.exit_code == 0, result.stderr
    assert path.read_bytes()[:3] == b"GIF"
