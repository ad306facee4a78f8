"""Where numbers come from, and how long steps took."""

from pathlib import Path

import clothsim as cs
import pytest
from clothsim.base.clocks import StepTimer
from clothsim.machine.origin import processor, provenance

CPUINFO = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 25
model\t\t: 17
model name\t: AMD EPYC
stepping\t: 1

processor\t: 1
model\t\t: 18
model name\t: another
"""


def test_provenance_names_build_machine_and_time():
    about = provenance()
    assert about["build"] == cs.build_config()
    assert about["machine"]["cpu"] and about["machine"]["cores"] >= 1
    assert about["created"].endswith("+00:00")


UNKNOWN = {"family": None, "model": None, "stepping": None}


@pytest.mark.parametrize(
    "told, expected",
    [
        (CPUINFO, {"cpu": "AMD EPYC", "family": 25, "model": 17, "stepping": 1}),
        ("model name : A\nstepping : unknown\n", {"cpu": "A", **UNKNOWN}),
    ],
)
def test_processors_of_one_name_are_distinguished(monkeypatch, told, expected):
    monkeypatch.setattr(Path, "read_text", lambda self: told)
    assert processor() == expected


def test_processor_has_a_name_where_the_system_has_no_such_file(monkeypatch):
    def missing(self):
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", missing)
    monkeypatch.setattr("platform.processor", lambda: "")
    monkeypatch.setattr("platform.machine", lambda: "arm64")
    assert processor() == {"cpu": "arm64", **UNKNOWN}


@pytest.mark.parametrize("seconds, expected", [(100.0, 1000), (2.0, None), (0.0, 1)])
def test_timed_steps_end_at_their_number_or_in_time(monkeypatch, seconds, expected):
    """Steps of 5 ms on a clock of their own."""
    now, parts = 0.0, []

    def advance(steps):
        nonlocal now
        now += 5e-3 * steps
        parts.append(steps)

    monkeypatch.setattr("clothsim.base.clocks.perf_counter", lambda: now)
    done, elapsed = StepTimer(advance).timed(1000, seconds)
    assert done == sum(parts) and elapsed == pytest.approx(5e-3 * done)
    assert max(parts) == (1 if done == 1 else StepTimer.LONGEST_PART / 5e-3)
    if expected:
        assert done == expected
    else:
        assert seconds <= elapsed < seconds + StepTimer.LONGEST_PART
