"""``drm modes``: the numbers of ``drm_env.Model`` as table, JSON and figure."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import drm_env
from typed_command import TypedCommand

_command = TypedCommand("modes")
succeed, refuse = _command.succeed, _command.refuse


def test_json_holds_the_frequencies_of_every_plant() -> None:
    content = json.loads(succeed("--json", "--payload-mass", 350, "--count", 2))
    assert content["extensions"] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    plants = content["natural_frequencies"]
    assert set(plants) == {"thesis", "consistent", "finite_element", "exact_rigid_link1"}
    for plant, rows in plants.items():
        model = drm_env.Model({"mass": 350.0}, plant=plant)
        for extension, row in zip(content["extensions"], rows, strict=True):
            assert row == pytest.approx(model.natural_frequencies(extension)[:2], rel=1e-12)


def test_options_reach_the_model() -> None:
    content = json.loads(
        succeed("--json", "--plant", "consistent", "--modes", 2, 3, "--shapes", "b9",
                "--extension", 2.5, "--payload-length", 0.4, "--payload-width", 0.2,
                "--payload-inertia", "slender", "--count", 5)
    )  # fmt: skip
    payload = {"mass": 200.0, "length": 0.4, "width": 0.2, "inertia": "slender"}
    model = drm_env.Model(payload, plant="consistent", modes=(2, 3), shapes="b9")
    (row,) = content["natural_frequencies"]["consistent"]
    assert row == pytest.approx(model.natural_frequencies(2.5), rel=1e-12)
    assert content["payload"] == payload


def test_table_shows_lengths_plants_and_hertz() -> None:
    text = succeed("--plant", "finite_element", "--plant", "thesis", "--extension", 4)
    assert "Hz" in text
    assert "200 kg" in text
    assert "finite_element" in text
    assert "exact" not in text
    first = drm_env.Model(plant="finite_element").natural_frequencies(4.0)[0]
    assert f"{first:.3f}" in text


def test_a_payload_in_space_names_its_modes() -> None:
    arguments = (
        "--plant", "spatial", "--extension", 8, "--payload-centre", 0.5, 0, 0.2,
        "--payload-tensor", 10, 20, 25, 0, 0, 0, "--payload-rotation-deg", 0, 0, 90,
        "--torsional-stiffness", 1.5e6, 1.9e6, "--count", 6,
    )  # fmt: skip
    content = json.loads(succeed("--json", *arguments))
    grapple = {
        "centre": [0.5, 0.0, 0.2],
        "inertia": [20.0, 10.0, 25.0, 0.0, 0.0, 0.0],  # turned by hand
    }
    model = drm_env.Model(
        {"mass": 200.0}, plant="spatial", grapple=grapple, torsional_stiffness=(1.5e6, 1.9e6)
    )
    (row,) = content["natural_frequencies"]["spatial"]
    assert row == pytest.approx(model.natural_frequencies(8.0, 6), rel=1e-9)
    assert content["kinds"]["spatial"] == [list(model.mode_kinds(8.0, 6))]
    text = succeed(*arguments)
    assert "out-of-plane bending" in text
    marks = {"in-plane bending": "", "out-of-plane bending": "o", "torsion": "t"}
    for frequency, kind in zip(row, model.mode_kinds(8.0, 6), strict=True):
        assert f"{frequency:.3f}{marks[kind]}" in text


def test_figure_is_written_once(tmp_path: Path) -> None:
    figure = tmp_path / "modes.png"
    succeed("--plot", figure, "--extension", 2, "--extension", 5, "--plant", "consistent")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert str(figure) in refuse("--plot", figure)
    succeed("--plot", figure, "--extension", 2, "--force")
    assert [file.name for file in tmp_path.iterdir()] == ["modes.png"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--plant", "rigid"), ("--plant", "rigid")),
        (("--extension", 9), ("extension", "9")),
        (("--payload-mass", -1), ("mass", "-1")),
        (("--payload-inertia", "thin"), ("inertia", "thin")),
        (("--shapes", "b6"), ("shapes", "b6")),
        (("--modes", 0, 0), ("modes", "[0, 0]")),
        (("--plant", "finite_element", "--modes", 2, 2), ("--modes", "consistent")),
        (("--plant", "thesis", "--elements", 9), ("--elements", "finite_element")),
        (("--payload-centre", 0.5, 0, 0.2), ("--payload-centre", "spatial")),
        (("--plant", "spatial", "--elements", 81), ("elements", "3 to 80")),
        (("--elements", 1), ("elements", "3 to 200")),
        (("--count", 100_000), ("count", "100000")),
    ],
)
def test_bad_arguments_are_refused(
    arguments: tuple[str | float, ...], words: tuple[str, ...]
) -> None:
    message = refuse(*arguments)
    assert all(word in message for word in words), message


def test_help_names_the_units() -> None:
    text = succeed("--help")
    assert all(unit in text for unit in (", m.", ", kg;", "(Hz)"))
