"""A command of ``drm`` as a user types it."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from drm_baselines.cli import app


class TypedCommand:
    """One command, with what may stand behind its name."""

    def __init__(self, name: str) -> None:
        self.name = name

    def run(self, *arguments: str | Path | float) -> Result:
        return CliRunner().invoke(app, [self.name, *(str(argument) for argument in arguments)])

    def succeed(self, *arguments: str | Path | float) -> str:
        """Return what it prints."""
        result = self.run(*arguments)
        assert result.exit_code == 0, result.output + result.stderr
        return result.stdout

    def refuse(self, *arguments: str | Path | float) -> str:
        """Run it where it must be refused; return its message, which is no traceback."""
        result = self.run(*arguments)
        assert result.exit_code == 2, result.output
        assert "Traceback" not in result.stderr
        return " ".join(result.stderr.split())
