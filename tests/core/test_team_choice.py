"""`threads=None`: one thread or the team, by what steps of each have cost, on a machine made of numbers."""

import pytest
from clothsim._core import Crowding, TeamChoice
from variants import pairs


class Machine:
    """Steps that cost `one` on one thread and `team` on the team [s], in calls of up to `chunk` and some 10 ms."""

    def __init__(self, one, team, team_first, chunk=64):
        self.choice = TeamChoice(team_first)
        self.one, self.team = one, team
        self.chunk = max(1, min(chunk, int(0.01 / max(one, team))))
        self.seconds = self.steps = self.on_team = 0

    def run(self, seconds):
        end = self.seconds + seconds
        while self.seconds < end:
            steps = self.choice.steps(self.chunk)
            assert 1 <= steps <= self.chunk
            took = steps * (self.team if self.choice.team else self.one)
            self.on_team += steps * self.choice.team
            self.steps += steps
            self.seconds += took
            self.choice.observe(steps, took)
        return self


@pairs(costs=[(9e-6, 5e-6), (9e-6, 8e-6), (2e-6, 6e-6), (1e-2, 5e-3), (3e-6, 3e-4)], team_first=[False, True], chunk=[1, 64])
def test_the_cheaper_one_takes_nearly_all_steps(costs, team_first, chunk):
    one, team = costs
    machine = Machine(one, team, team_first, chunk).run(max(2.0, 2000 * max(one, team)))
    assert machine.seconds < 1.03 * machine.steps * min(one, team)


def test_a_short_run_does_not_wake_the_team():
    machine = Machine(9e-6, 5e-6, team_first=False).run(1e-4)
    assert machine.on_team == 0


def test_a_team_whose_processor_is_taken_is_left_at_once():
    """Steps of 3 ms instead of 5 us: those of the call in which it happens, and then a few trials of a step or two."""
    machine = Machine(9e-6, 5e-6, team_first=False).run(1.0)
    assert machine.choice.team
    machine.team = 3e-3
    seconds, steps, on_team = machine.seconds, machine.steps, machine.on_team
    machine.run(3.0)
    assert not machine.choice.team
    assert machine.on_team - on_team < 64 + 8
    assert machine.seconds - seconds < (machine.steps - steps) * machine.one + 0.215
    machine.team = 5e-6
    machine.run(1.0)
    assert machine.choice.team


@pytest.mark.parametrize(("slept_every_10_ms", "crowded"), [(0, False), (0.4e6, False), (4e6, True)])
def test_a_requested_team_is_crowded_if_its_threads_sleep_for_long(slept_every_10_ms, crowded):
    """Nanoseconds: a quiet virtual machine pauses for some 4 %, two busy processes take half of the time."""
    crowding = Crowding()
    assert any(crowding.observe(int(slept_every_10_ms), 0.01) for _ in range(1000)) == crowded
