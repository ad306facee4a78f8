"""Progress bars: in a terminal or a notebook, never in a pipe, and every command has the same."""

import io
import sys

import pytest
from clothsim.base.progress import ProgressBar, wanted_by_command
from clothsim.cli import main

pytest.importorskip("tqdm")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def stderr(monkeypatch, kind):
    """Set a new stderr; not in a fixture, as pytest sets its own when the test begins."""
    file = kind()
    monkeypatch.setattr(sys, "stderr", file)
    return file


def test_a_bar_counts_in_a_terminal(monkeypatch):
    terminal = stderr(monkeypatch, Terminal)
    with ProgressBar(True, total=4, unit="frame", desc="export", mininterval=0) as bar:
        bar.advance()
        bar.advance(2)
    assert "export:  75%" in terminal.getvalue() and "3/4" in terminal.getvalue()


def test_nothing_is_shown_in_a_pipe_or_unasked(monkeypatch):
    terminal = stderr(monkeypatch, Terminal)
    with ProgressBar(False, total=4) as bar:
        bar.advance()
    assert terminal.getvalue() == "" and wanted_by_command()
    pipe = stderr(monkeypatch, io.StringIO)
    with ProgressBar(True, total=4, mininterval=0) as bar:
        bar.advance()
    assert pipe.getvalue() == "" and not wanted_by_command()


SWING = ("paper_swing", "--duration", "0.1", "--dt", "1e-3")


@pytest.mark.parametrize(
    ("arguments", "text_of_bar"),
    [
        (("run", *SWING, "--every", "0.02", "--out", "{}/r.npz"), "100%"),
        (("run", *SWING, "--film", "{}/r.gif"), "film: 100%"),
        (("run", *SWING, "--export", "{}/a.obj"), "export: 100%"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else None,
)
def test_commands_show_a_bar_in_a_terminal_alone(
    tmp_path_factory, monkeypatch, arguments, text_of_bar
):
    terminal = stderr(monkeypatch, Terminal)
    folder = tmp_path_factory.getbasetemp()
    arguments = [text.format(folder) for text in arguments]
    assert main(arguments) == 0, terminal.getvalue()
    assert text_of_bar in terminal.getvalue()
    pipe = stderr(monkeypatch, io.StringIO)
    assert main(arguments) == 0 and pipe.getvalue() == ""
