"""Commands as a user runs them, in the process of the test."""

from clothsim.cli import main


def run(capsys, *arguments):
    """Exit code, stdout and stderr of one command, whose first argument is split at blanks."""
    first, *others = map(str, arguments or ("",))
    try:
        code = main([*first.split(), *others])
    except SystemExit as stop:
        code = stop.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err
