"""Natural frequencies and mode shapes of ``drm_env.Model``: the golden tables through Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parent / "golden" / "thesis_tables.json").read_text()
)
MASSES = {"PNone": 0.0, "P0": 50.0, "P1": 200.0, "P2": 350.0, "P3": 500.0}
PLANTS = ("thesis", "consistent", "finite_element", "exact_rigid_link1")


def compare(table: str, **options: Any) -> None:
    """Compare every entry of a table by payload and extension that is not marked as deviating."""
    entry = GOLDEN[table]
    inertia = "slender" if "slender" in entry["recipe"] else "full"
    compared = 0
    for key, published in entry["values"].items():
        if key in entry.get("deviating", {}):
            continue
        payload, a, mode = key.split(" ")
        model = drm_env.Model(payload={"mass": MASSES[payload], "inertia": inertia}, **options)
        found = model.natural_frequencies(float(a[2:]))[int(mode[1:]) - 1]
        assert found == pytest.approx(published, rel=entry["tolerance_percent"] / 100.0), key
        compared += 1
    assert compared >= 0.75 * len(entry["values"])


def test_one_mode_a_link_is_table_2_9() -> None:
    compare("table_2_9")


def test_rigid_link_1_is_table_2_8() -> None:
    compare("table_2_8_assumed_modes", modes=(0, 2))


def test_exact_rigid_link_1_is_the_reference() -> None:
    compare("reference_rigid_link1", plant="exact_rigid_link1")


def test_finite_elements_are_the_reference() -> None:
    compare("reference_arm", plant="finite_element")


@pytest.mark.parametrize("family", ["B7", "B8", "B9"])
def test_families_are_table_2_10(family: str) -> None:
    entry = GOLDEN[f"table_2_10_{family}"]
    for key, published in entry["values"].items():
        if key in entry.get("deviating", {}):
            continue
        _, a, modes, which = key.split(" ")
        n = int(modes.removeprefix("n=m="))
        model = drm_env.Model({"inertia": "slender"}, modes=(n, n), shapes=family.lower())
        found = model.natural_frequencies(float(a[2:]))
        assert found.shape == (2 * n,)
        tolerance = entry["tolerance_percent"] / 100.0
        assert found[int(which[1:]) - 1] == pytest.approx(published, rel=tolerance), key


def test_thesis_frequencies_are_those_of_its_matrices() -> None:
    model = drm_env.Model(dynamics={"axial_load": False})
    for extension in (1.0, 3.3, 8.0):
        mass, _, stiffness = model.matrices(extension)
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
        expected = np.sqrt(squares[1:]) / (2.0 * np.pi)
        np.testing.assert_allclose(model.natural_frequencies(extension), expected, rtol=1e-8)


@pytest.mark.parametrize("plant", PLANTS)
def test_mode_shapes(plant: str) -> None:
    model = drm_env.Model(plant=plant)
    shapes = model.mode_shapes(4.0, count=2)
    assert isinstance(shapes, tuple)
    positions, displacements, frequencies = shapes
    assert positions[0] == 0.0
    assert positions[-1] == pytest.approx(11.0)
    assert np.all(np.diff(positions) > 0.0)
    assert displacements.shape == (2, positions.size)
    np.testing.assert_array_equal(frequencies, model.natural_frequencies(4.0, count=2))
    assert frequencies[0] < frequencies[1]
    np.testing.assert_allclose(np.abs(displacements).max(axis=1), 1.0)
    np.testing.assert_allclose(displacements[:, 0], 0.0, atol=1e-12)
    assert np.all(displacements[:, -1] >= 0.0)


@pytest.mark.parametrize("plant", PLANTS[1:])
def test_the_shape_of_each_mode_has_one_node_more(plant: str) -> None:
    """A hinged beam with a free end: k nodes between hinge and tip in mode k.

    The thesis' arm is none: its axis has a kink at the end of link 1.
    """
    shapes = drm_env.Model({"mass": 0.0}, plant=plant).mode_shapes(4.0, count=2)
    inner = shapes.displacements[:, 1:]
    crossings = np.count_nonzero(np.diff(np.sign(inner), axis=1), axis=1)
    np.testing.assert_array_equal(crossings, [1, 2])


def test_link_1_is_straight_when_rigid() -> None:
    for model in (drm_env.Model(plant="exact_rigid_link1"), drm_env.Model(modes=(0, 4))):
        shapes = model.mode_shapes(4.0, count=1)
        inside = shapes.positions <= 7.0
        slope = shapes.displacements[0, inside][1:] / shapes.positions[inside][1:]
        np.testing.assert_allclose(slope, slope[0], rtol=1e-9)


def test_end_slope_of_link_1_matters() -> None:
    """The thesis' kinematics overestimate the first frequency: far more, the shorter link 2."""
    consistent = drm_env.Model(plant="consistent", modes=(8, 8))
    thesis = drm_env.Model()
    excess = [
        thesis.natural_frequencies(a)[0] / consistent.natural_frequencies(a)[0] - 1.0
        for a in (2.0, 4.0, 6.0, 8.0)
    ]
    np.testing.assert_allclose(excess, [0.81, 0.28, 0.155, 0.16], atol=0.015)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": "exact_rigid_link1", "modes": (2, 2)}, r"modes.*exact_rigid_link1.*\[2, 2\]"),
        ({"plant": "finite_element", "shapes": "b8"}, r"shapes.*finite_element.*b8"),
        ({"plant": "consistent", "elements": 10}, r"elements.*consistent.*10"),
        ({"plant": "finite_element", "elements": 2}, r"elements.*3 to 200.*2"),
        ({"plant": "finite_element", "elements": 201}, r"elements.*3 to 200.*201"),
        ({"modes": (0, 0)}, r"modes.*not both 0.*\[0, 0\]"),
        ({"modes": (41, 1)}, r"modes.*40.*41"),
        ({"modes": (1, 2, 3)}, r"modes"),
        ({"modes": 3}, r"modes"),
        ({"modes": (-1, 2)}, r"modes.*-1"),
        ({"shapes": "b6"}, r"shapes.*b6"),
        ({"plant": "rigid"}, r"plant.*rigid"),
    ],
)
def test_impossible_models_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.Model(**options)


@pytest.mark.parametrize("plant", PLANTS[1:])
def test_only_the_thesis_plant_gives_accelerations_and_energies(plant: str) -> None:
    model = drm_env.Model(plant=plant)
    zero = np.zeros(3)
    for call in (
        lambda: model.acceleration(zero, zero, 3.0),
        lambda: model.energy(zero, zero, 3.0),
        lambda: model.angular_momentum(zero, zero, 3.0),
    ):
        with pytest.raises(drm_env.ConfigError, match=rf"plant.*{plant}"):
            call()


def test_more_modes_have_no_equations_of_motion() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"modes.*\[2, 2\]"):
        drm_env.Model(modes=(2, 2)).matrices(3.0)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("count", [0, -1, 1.5, True, 10_000])
def test_impossible_counts_are_refused(plant: str, count: Any) -> None:
    model = drm_env.Model(plant=plant)
    with pytest.raises(drm_env.ConfigError, match=rf"count.*{count}"):
        model.natural_frequencies(3.0, count=count)
    with pytest.raises(drm_env.ConfigError, match=rf"count.*{count}"):
        model.mode_shapes(3.0, count=count)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("extension", [0.5, 8.5, np.nan])
def test_impossible_extensions_are_refused(plant: str, extension: float) -> None:
    model = drm_env.Model(plant=plant)
    with pytest.raises(drm_env.ConfigError, match="extension"):
        model.natural_frequencies(extension)
    with pytest.raises(drm_env.ConfigError, match="extension"):
        model.mode_shapes(extension)


def test_a_payload_out_of_the_plane_mixes_bending_with_torsion() -> None:
    """On the axis each kind of motion is by itself, and each mode says what it is."""
    on_axis = drm_env.Model(plant="spatial").spatial_modes(8.0, 6)
    assert set(on_axis.kinds) == {"in-plane bending", "out-of-plane bending", "torsion"}
    np.testing.assert_allclose(on_axis.shares.max(axis=1), 1.0, atol=1e-9)
    plane = drm_env.Model(plant="finite_element").natural_frequencies(8.0, 2)
    in_plane = [k for k, kind in enumerate(on_axis.kinds) if kind == "in-plane bending"]
    np.testing.assert_allclose(on_axis.frequencies[in_plane][:2], plane, rtol=1e-6)

    held = drm_env.Model(plant="spatial", grapple={"centre": [0.5, 0.0, 0.2]})
    mixed = held.spatial_modes(8.0, 6)
    torsion = mixed.kinds.index("torsion")
    assert 0.01 < mixed.shares[torsion, 0] < 0.5
    assert mixed.shares[torsion, 1] < 1e-12
    assert held.mode_kinds(8.0, 6) == mixed.kinds
    np.testing.assert_array_equal(held.natural_frequencies(8.0, 6), mixed.frequencies)
    assert mixed.in_plane.shape == mixed.out_of_plane.shape == mixed.twist.shape == (6, 201)
    shapes = np.abs([mixed.in_plane, mixed.out_of_plane, mixed.twist])
    np.testing.assert_allclose(shapes.max(axis=(0, 2)), 1.0)
    assert (mixed.out_of_plane[:, 0] == 0.0).all() and (mixed.twist[:, 0] == 0.0).all()


def test_plane_models_have_bending_in_the_plane_alone() -> None:
    for plant in PLANTS:
        model = drm_env.Model(plant=plant)
        assert model.mode_kinds(4.0, 2) == ("in-plane bending",) * 2
        with pytest.raises(drm_env.ConfigError, match="spatial"):
            model.spatial_modes(4.0)
        with pytest.raises(drm_env.ConfigError, match=rf"grapple.*{plant}"):
            drm_env.Model(plant=plant, grapple={"centre": [0.5, 0.0, 0.2]})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"grapple": {"centre": [0.5, 0.0]}}, "centre"),
        ({"grapple": {"center": [0.5, 0.0, 0.2]}}, "center"),
        ({"grapple": {"inertia": [-1.0, 1.0, 1.0, 0.0, 0.0, 0.0]}}, "grapple.inertia"),
        ({"torsional_stiffness": (1e6, 0.0)}, r"torsional_stiffness\[1\]"),
        ({"elements": 81}, r"elements.*3 to 80.*81"),
        ({"modes": (2, 2)}, r"modes.*spatial"),
    ],
)
def test_impossible_payloads_in_space_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.Model(plant="spatial", **options)
