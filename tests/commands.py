"""Commands as a user runs them, in the test's process, and code in an interpreter of its own."""

import os
import subprocess
import sys

from clothsim.cli import main


def run(capsys, *arguments):
    """Exit code, stdout and stderr of one command, whose first argument is split at blanks."""
    first, *arguments_after = map(str, arguments or ("",))
    try:
        code = main([*first.split(), *arguments_after])
    except SystemExit as stop:
        code = stop.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def python(code, *arguments, timeout=120, **environment):
    """Exit code and both streams of a new interpreter with further variables in its environment."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=timeout, env={**os.environ, **environment}
    )
