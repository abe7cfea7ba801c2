"""The documentation: notebooks run, the site builds without a warning and without a dead link."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
SMALLER = {
    "STEPS = 120_000": "STEPS = 4_096",
    "EPISODES = 64": "EPISODES = 8",
    "n=100)": "n=8)",
    "np.linspace(1e4, 1.2e5, 23)": "np.linspace(1e4, 1.2e5, 4)",
}
"""What the notebooks have, and what they are run with."""


def tool(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, ROOT / "tools" / name, *map(str, arguments)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip


# --- notebooks ------------------------------------------------------------------------------------


def test_there_are_three_notebooks_and_what_is_made_smaller_is_in_them() -> None:
    assert {path.stem for path in NOTEBOOKS} == {
        "first_flight", "train_and_compare", "design_a_law",
    }  # fmt: skip
    text = "".join(path.read_text(encoding="utf-8") for path in NOTEBOOKS)
    assert all(large in text for large in SMALLER)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_what_it_printed(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    text = path.read_text(encoding="utf-8")
    for large, small in SMALLER.items():
        text = text.replace(large, small)
    notebook = nbformat.reads(text, as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    printed = [
        output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
    ]
    assert [output for output in printed if output.get("name") == "stderr"] == []
    assert [output for output in printed if "image/png" in output.get("data", {})]
    assert list(tmp_path.iterdir()) == []


# --- drawings -------------------------------------------------------------------------------------


def test_the_drawings_are_those_that_the_tool_makes(tmp_path: Path) -> None:
    done = tool("diagrams.py", tmp_path)
    assert done.returncode == 0, done.stderr
    drawn = sorted(tmp_path.iterdir())
    assert drawn
    for path in drawn:
        assert path.read_bytes() == (DOCS / "images" / path.name).read_bytes(), path.name


# --- the site -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as ``make docs`` builds it, without notebooks' outputs and the engine's pages."""
    for package in ("sphinx", "myst_nb", "furo", "sphinx_copybutton", "sphinx_design"):
        pytest.importorskip(package)
    out = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [
            sys.executable, "-m", "sphinx", "--builder", "html", "--fail-on-warning",
            "--keep-going", "--quiet", "--define", "nb_execution_mode=off",
            "--doctree-dir", tmp_path_factory.mktemp("doctrees"), DOCS, out,
        ],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    # what cargo doc writes there
    (out / "rust" / "drm_env").mkdir(parents=True)
    (out / "rust" / "drm_env" / "index.html").write_text("<title>drm_env</title>")
    return out


@pytest.mark.slow
def test_the_site_has_every_page_and_no_dead_link(site: Path) -> None:
    for page in DOCS.glob("*.md"):
        assert (site / f"{page.stem}.html").is_file(), page.name
    done = tool("check_site.py", site)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_dead_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<a href="b.html#there">1</a><a href="b.html#gone">2</a>'
        '<img src="no.png"><a href="#x">3</a>'
    )
    (tmp_path / "b.html").write_text('<p id="there"><a href="https://example.org">4</a>')
    done = tool("check_site.py", tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines() == ["a.html: b.html#gone", "a.html: no.png", "a.html: #x"]


@pytest.mark.slow
def test_the_reference_names_everything_public(site: Path) -> None:
    import drm_baselines
    import drm_env
    from drm_baselines.cli.application import app

    text = (site / "api.html").read_text(encoding="utf-8")
    for module in (drm_env, drm_baselines):
        for name in module.__all__:
            if not name.startswith("__"):
                assert f"{module.__name__}.{name}" in text, name
    text = (site / "commands.html").read_text(encoding="utf-8")
    for command in app.registered_commands:
        assert f"drm {command.callback.__name__}" in text  # type: ignore[union-attr]
    text = (site / "environments.html").read_text(encoding="utf-8")
    for name in (*drm_env.option_names(), "drm_env/SlewFlexible-v0", "link2_deflection_rate_fine"):
        assert name in text, name


@pytest.mark.slow
@pytest.mark.parametrize("width", [1360, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_are_readable_on_any_screen(
    site: Path, browser: Any, width: int, scheme: str
) -> None:
    """Nothing is complained of, nothing is fetched from elsewhere, and no page scrolls sideways."""
    complaints, asked = [], []
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.on("console", lambda said: complaints.append(said.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    for name in ("index", "environments", "benchmark", "commands", "api", "changelog"):
        page.goto((site / f"{name}.html").as_uri())
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, (name, wide)
    page.close()
    assert complaints == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
