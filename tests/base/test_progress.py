"""Progress bars: in a terminal or a notebook, never in a pipe, and every command has the same."""

import io
import sys

import clothsim as cs
import pytest
from clothsim.base.progress import ProgressBar, is_wanted_by_command
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
    assert terminal.getvalue() == "" and is_wanted_by_command()
    pipe = stderr(monkeypatch, io.StringIO)
    with ProgressBar(True, total=4, mininterval=0) as bar:
        bar.advance()
    assert pipe.getvalue() == "" and not is_wanted_by_command()


def test_a_notebook_has_its_bar_beside_the_output_and_not_in_red(monkeypatch, capsys):
    monkeypatch.setattr("clothsim.base.progress.is_in_notebook", lambda: True)
    with ProgressBar.for_simulated_time(True, 2.0, "fit") as bar:
        bar.expect_more(2.0)
        bar.advance(4.0)
    shown = capsys.readouterr()
    assert shown.err == "" and "4/4 s of simulated time" in shown.out


def totals(monkeypatch, call):
    """Return what each bar of a call counted, and its total."""
    bars = []
    init = ProgressBar.__init__

    def kept(self, *given, **options):
        init(self, *given, **options)
        bars.append(self.bar)

    monkeypatch.setattr(ProgressBar, "__init__", kept)
    stderr(monkeypatch, Terminal)
    call()
    return [(bar.n, bar.total) for bar in bars if bar is not None]


@pytest.mark.parametrize("name", ["animate", "fit", "work_precision"])
def test_bars_of_simulated_time_reach_their_total(name, monkeypatch, tmp_path):
    scene = cs.scenes.oscillator(damping=1.0)
    run = cs.simulate(scene, 0.4, dt=1e-2, every=0.1)
    guess = cs.scenes.oscillator(damping=1.0, stiffness=90.0)
    calls = {
        "animate": lambda: run.animate(tmp_path / "a.gif", fps=7, width=64, progress=True),
        "fit": lambda: cs.fit(guess, run.t[1:], run.x[1:], ["stiffness"], progress=True),
        "work_precision": lambda: cs.work_precision(
            scene, 0.4, ["rk4"], dts=[1.0, 0.1, 0.05], windows=2, progress=True
        ),
    }
    ((count, total),) = totals(monkeypatch, calls[name])
    assert count == pytest.approx(total) and total >= 0.4


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
