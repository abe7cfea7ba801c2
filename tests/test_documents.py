"""What the documents tell people to do: code runs, commands and files are there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drm_baselines.support.extras import EXTRAS
from drm_env.constants import TABLE_2_7

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("examples/*.md")])
LIVING = [page for page in PAGES if page.name != "CHANGELOG.md"]

SMALLER = {
    "num_envs=1024": "num_envs=8",
    "n=1000": "n=8",
    "n=100,": "n=4,",
    "n_envs=32": "n_envs=2",
    "n_steps=128, batch_size=256": "n_steps=32, batch_size=16",
    ".learn(250_000)": ".learn(2)",
    '"episodes": 20': '"episodes": 2',
}
"""What the code of the pages has, and what it is run with."""


RUN_BY = {"ecosystem.md": "tests/test_ecosystem.py"}
"""Pages whose code needs libraries that may be missing, and the tests that run their blocks."""


def blocks(page: Path, *languages: str) -> Iterator[str]:
    """Yield the fenced blocks of a page in one of the languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M)
    for language, text in found:
        if language in languages:
            yield text


def commands(page: Path) -> Iterator[str]:
    """Yield the commands in fenced and indented blocks of a page, without comments."""
    lines = [line for block in blocks(page, "sh", "bash") for line in block.splitlines()]
    lines += re.findall(r"^    (drm .*|make .*)$", page.read_text(encoding="utf-8"), re.M)
    for line in lines:
        for command in re.split(r";|&&", line.split(" #")[0]):
            if command.strip():
                yield command.strip()


def all_commands(program: str) -> list[str]:
    return [
        command for page in LIVING for command in commands(page) if command.split()[0] == program
    ]


# --- code -----------------------------------------------------------------------------------------


def script(page: Path) -> str:
    """All Python of a page one after the other, as somebody types it."""
    return "\n".join(blocks(page, "python"))


def with_code() -> list[Any]:
    found = []
    for page in PAGES:
        code = script(page)
        if code and page.name not in RUN_BY:
            slow = [pytest.mark.slow] if "stable_baselines3" in code else []
            found.append(pytest.param(page, id=page.name, marks=slow))
    return found


WRITTEN_BY = {"reports.md": {"slew.html"}}
"""Files that the code of a page writes, where it says so."""


@pytest.mark.parametrize("page", with_code())
def test_the_code_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    code = script(page)
    for large, small in SMALLER.items():
        code = code.replace(large, small)
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    left = {path.name for path in tmp_path.iterdir()}
    assert left <= WRITTEN_BY.get(page.name, set())


def test_code_that_is_run_elsewhere_is_run_there() -> None:
    for page, test in RUN_BY.items():
        if (ROOT / "docs" / page).exists():
            assert page in (ROOT / test).read_text(encoding="utf-8")


def test_what_is_made_smaller_is_there() -> None:
    code = "\n".join(script(page) for page in PAGES)
    for large in SMALLER:
        assert large in code, f"no page has {large!r} any more"


def test_no_code_escapes_the_tests() -> None:
    """A fence that is not closed, or is indented or of a kind that nobody reads, hides its code."""
    known = {
        "python", "sh", "bash", "text", "json", "toml", "console", "rust",
        "{toctree}", "{eval-rst}",
    }  # fmt: skip
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fences = re.findall(r"^[ ]*```(.*)$", text, re.M)
        assert len(fences) % 2 == 0, page.name
        assert set(fences[::2]) <= known, (page.name, set(fences[::2]) - known)
        assert set(fences[1::2]) <= {""}, page.name


def test_the_table_of_payloads_is_the_engines() -> None:
    text = (ROOT / "docs" / "payload.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| Payload \d.*?\| ([\d.]+) kg \| ([\d.]+) m \| ([\d.]+) m \|", text, re.M)
    assert [tuple(map(float, row)) for row in rows] == [tuple(row) for row in TABLE_2_7[1:]]


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", all_commands("drm"))
def test_a_command_is_one_that_drm_takes(command: str) -> None:
    """Read by the command line itself, up to where the work would begin."""
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    words = shlex.split(command)[1:]
    # places that the text around a command defines
    words = [word.replace("$learners", "learners") for word in words]
    if words[0].startswith("-"):
        assert set(words) <= {name for each in group.params for name in each.opts}
        return
    chosen = group.commands[words[0]]
    context = chosen.make_context(words[0], words[1:])
    assert not context.args


def drm(command: str, directory: Path) -> None:
    """Run a command as somebody does who has typed it into a terminal."""
    program = "from drm_baselines.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *shlex.split(command)[1:]],
        cwd=directory, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_light_command_of_the_pages_does_what_it_says(tmp_path: Path) -> None:
    for command in (
        "drm simulate --law lyapunov --mass-error 0.15 --out flight",
        "drm modes --payload-mass 200",
    ):
        assert command in all_commands("drm")
        drm(command, tmp_path)
    assert {path.name for path in (tmp_path / "flight").iterdir()} == {
        "lyapunov.csv", "simulation.json", "manoeuvre.png",
    }  # fmt: skip


JOURNEY = "From a clone to your own agent"
CHEAPER = {
    "--steps 1000000": "--steps 2000 --evaluations 1 --evaluation-episodes 4",
    "--output mine.mp4": "--output mine.mp4 --duration 1 --fps 5 --width 320 --height 240",
    "--episodes 100": "--episodes 4",
}


def journey() -> list[str]:
    """The lines that a newcomer types."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    part = text.split(f"## {JOURNEY}", 1)[1].split("\n## ", 1)[0]
    (block,) = re.findall(r"^```sh\n(.*?)^```$", part, re.S | re.M)
    return str(block).splitlines()


def test_a_newcomer_types_at_most_six_commands() -> None:
    lines = journey()
    assert len(lines) <= 6
    assert lines[0].startswith("git clone")
    assert "make build" in lines


@pytest.mark.slow
def test_a_newcomer_gets_an_agent_its_film_and_its_page(tmp_path: Path) -> None:
    """README's lines after the installation, with a small budget."""
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("imageio_ffmpeg")
    typed = [line for line in journey() if line.startswith("drm ")]
    assert [line.split()[1] for line in typed] == ["train", "render", "compare"]
    text = "\n".join(typed)
    for dear, cheap in CHEAPER.items():
        assert dear in text
        text = text.replace(dear, cheap)
    for command in text.splitlines():
        drm(command, tmp_path)
    assert (tmp_path / "runs" / "mine" / "policy.safetensors").is_file()
    assert (tmp_path / "mine.mp4").stat().st_size > 1000
    assert "<html" in (tmp_path / "comparison.html").read_text(encoding="utf-8")


def options_of(command: str) -> set[str]:
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    return {name for each in group.commands[command].params for name in each.opts}


def test_commands_in_running_text_exist_with_their_options() -> None:
    import typer

    from drm_baselines.cli import app

    group: Any = typer.main.get_command(app)
    found = 0
    for page in PAGES:
        for text in re.findall(r"`drm ([a-z][^`]*)`", page.read_text(encoding="utf-8")):
            command, *words = text.split()
            assert command in group.commands, (page.name, text)
            for word in words:
                if word.startswith("--"):
                    assert word.strip(".,") in options_of(command), (page.name, text)
                    found += 1
    assert found > 20


def test_make_has_every_target_that_is_named() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
    text = "\n".join(page.read_text(encoding="utf-8") for page in LIVING)
    named = set(re.findall(r"`make ([a-z]+)`|^make ([a-z]+)", text, re.M))
    words = {word for pair in named for word in pair if word}
    assert {"demo", "test", "lint"} <= words <= targets


def test_the_extras_of_the_page_are_all_there_are() -> None:
    table = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", table.split("./baselines[...]", 1)[1], re.M)
    assert set(rows[: len(EXTRAS) + 1]) == {*EXTRAS, "all"}


def test_the_readme_is_one_page() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 90
    assert len(re.findall(r"^\|---", text, re.M)) == 1


# --- files ----------------------------------------------------------------------------------------

_PLACE = re.compile(
    r"`((?:\.github|baselines|docs|drm_env|examples|python|tests|tools)/[\w./*-]+|[A-Z]+\.md)`"
)


@pytest.mark.parametrize("page", LIVING, ids=lambda page: page.name)
def test_files_that_a_page_names_are_there(page: Path) -> None:
    for place in _PLACE.findall(page.read_text(encoding="utf-8")):
        if re.fullmatch(r"drm_env/\w+-v\d", place):
            continue  # the id of an environment
        assert list(ROOT.glob(place.rstrip("/").replace("NAME", "*"))), f"{page.name} names {place}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
