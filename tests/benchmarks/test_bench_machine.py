"""What the bench asks the machine."""

import itertools
import os
from types import SimpleNamespace

import clothsim as cs
from bench import machine_facts


def test_limits_are_of_their_instruction_set_precision_and_threads(monkeypatch):
    def here():
        return os.environ["CLOTHSIM_ISA"]

    def bandwidth(threads, size):
        return {kind: (kind, here(), threads, size) for kind in ("update", "triad")}

    limits = SimpleNamespace(
        multiply_add_peak=lambda precision, threads: (here(), precision, threads),
        memory_bandwidth=bandwidth,
        core_round_trip=lambda: 1e-7,
    )
    monkeypatch.setattr(machine_facts, "this_machine", limits)
    found = machine_facts.limits(("avx2", "sse2"), (1, 2))
    assert set(found["peak"]) == set(itertools.product(("avx2", "sse2"), ("single", "double"), (1, 2)))
    assert all(rate == key for key, rate in found["peak"].items())
    for name, kind, size in (
        ("bandwidth", "update", 1 << 29),
        ("triad", "triad", 1 << 29),
        ("cache_bandwidth", "update", 1 << 14),
    ):
        assert found[name] == {n: (kind, "avx2", n, size) for n in (1, 2)}
    assert found["round_trip"] == 1e-7
    assert machine_facts.limits(("sse2",), (1,))["round_trip"] is None
    rows = machine_facts.as_plain(found)["peak"]
    assert {
        "instruction_set": "sse2",
        "precision": "double",
        "threads": 2,
        "flops_per_second": ("sse2", "double", 2),
    } in rows
    assert len(rows) == 8 and machine_facts.as_plain({}) == {}


def test_instruction_set_is_put_back(monkeypatch):
    monkeypatch.delenv("CLOTHSIM_ISA", raising=False)
    with machine_facts.instruction_set("sse2"):
        assert cs.build_config()["instruction_set"] == "sse2"
    assert cs.build_config()["instruction_set"] != "sse2"


def test_file_names_tell_processors_of_one_name_apart():
    about = {"cpu": "Some(R) CPU @ 2", "cores": 2, "build": {"instruction_set": "avx2"}}
    assert machine_facts.slug({**about, "family": 26, "model": 2}) == ("some-cpu-2-family-26-model-2-2-cores-avx2")
    assert machine_facts.slug({**about, "family": None, "model": None}) == "some-cpu-2-2-cores-avx2"
