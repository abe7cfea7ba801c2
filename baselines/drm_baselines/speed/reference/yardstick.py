"""The yardstick: the thesis plant in plain C, compiled here and now for this machine."""

from __future__ import annotations

import contextlib
import json
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import drm_env
from drm_baselines.errors import BaselineError

SOURCE = Path(__file__).with_name("yardstick.c")
LANES = 8
"""Manoeuvres side by side in the yardstick with lanes."""
STEPS = 26_421
"""Runge-Kutta steps of one repetition: the samples that end before the slew does."""
TOLERANCE = 1e-6
"""Largest relative difference from the engine that is taken for the same mechanics."""

_TIMEOUT = 300.0


class NoCompilerError(BaselineError):
    """There is no C compiler here."""


class YardstickError(BaselineError):
    """The yardstick fails, or does not fly where the engine flies."""


class CompilationError(BaselineError):
    """The compiler refuses the yardstick."""


@dataclass(frozen=True)
class Outcome:
    """What one call of a yardstick prints."""

    lanes: int
    axial: bool
    ns_per_step: float
    """Best time of a step an environment over all repetitions, ns."""
    steps: int
    samples: int
    slew_angle: float
    """Slew angle after the last sample, rad."""
    tip_deflection: float
    """Tip deflection after the last sample, m."""


@dataclass(frozen=True)
class Yardstick:
    """A compiled yardstick."""

    program: Path
    command: tuple[str, ...]
    """How it was compiled."""

    def run(self, repetitions: int = 20) -> Outcome:
        """Fly the manoeuvre some times over.

        Raises
        ------
        YardstickError
            The program fails.
        """
        return _outcome(_output([str(self.program), str(repetitions)]))


def _output(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT)
    except (OSError, subprocess.SubprocessError) as error:
        raise YardstickError(f"{Path(command[0]).name} cannot be run: {error}") from error
    if done.returncode != 0:
        message = done.stderr.strip().splitlines()
        raise YardstickError(
            f"{Path(command[0]).name} ended with {done.returncode}: {message[:1] or 'no message'}"
        )
    return done.stdout


def _outcome(text: str) -> Outcome:
    try:
        content = json.loads(text)
        return Outcome(
            lanes=int(content["lanes"]),
            axial=bool(content["axial"]),
            ns_per_step=float(content["ns_per_step"]),
            steps=int(content["steps"]),
            samples=int(content["samples"]),
            slew_angle=float(content["slew_angle"]),
            tip_deflection=float(content["tip_deflection"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise YardstickError(f"the yardstick printed {text[:80]!r}: {error}") from error


def compiler() -> str:
    """Return the C compiler on the path: cc, gcc or clang.

    Raises
    ------
    NoCompilerError
        There is none of them.
    """
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return found
    raise NoCompilerError("no C compiler found (cc, gcc or clang)")


@contextlib.contextmanager
def compiled(lanes: int, *, axial: bool, machine: str = "native") -> Iterator[Yardstick]:
    """Compile a yardstick into a temporary directory, for the time of the ``with`` block.

    Parameters
    ----------
    lanes
        Manoeuvres side by side: 1 or a power of two.
    axial
        Whether the plant has the axial load.
    machine
        What ``-march`` gets.

    Raises
    ------
    NoCompilerError
        There is no compiler.
    CompilationError
        It refuses the source or an option.
    """
    with tempfile.TemporaryDirectory(prefix="drm-yardstick-") as directory:
        program = Path(directory) / "yardstick"
        command = (
            compiler(), "-std=c11", "-O3", f"-march={machine}", "-ffast-math", "-Wno-psabi",
            f"-DLANES={lanes}", f"-DAXIAL={int(axial)}", str(SOURCE), "-o", str(program), "-lm",
        )  # fmt: skip
        try:
            _output(list(command))
        except YardstickError as error:
            raise CompilationError(str(error)) from error
        shown = tuple(Path(part).name if Path(part).is_absolute() else part for part in command)
        yield Yardstick(program, shown)


def version_of_compiler() -> str:
    """Return the first line of what the compiler says about itself.

    Raises
    ------
    NoCompilerError
        There is none.
    """
    lines = _output([compiler(), "--version"]).strip().splitlines()
    return lines[0] if lines else "unknown compiler"


def check(outcome: Outcome) -> None:
    """Compare the end of a yardstick's manoeuvre with the engine's.

    Raises
    ------
    YardstickError
        They differ by more than :data:`TOLERANCE`.
    """
    flight = drm_env.simulate({"dynamics": {"axial_load": outcome.axial}}, "none")
    for name, value in (
        ("slew_angle", outcome.slew_angle),
        ("tip_deflection", outcome.tip_deflection),
    ):
        expected = float(flight[name][outcome.samples])
        if not abs(value - expected) <= TOLERANCE * abs(expected):
            raise YardstickError(
                f"the yardstick's {name} is {value!r} after {outcome.samples} samples, "
                f"the engine's {expected!r}"
            )


def portable_machine() -> str | None:
    """Return the ``-march`` of the instructions that valgrind knows on this machine, if any."""
    return {"x86_64": "x86-64-v3", "AMD64": "x86-64-v3", "aarch64": "armv8-a"}.get(
        platform.machine()
    )
