"""The tables of docs/accuracy.md: made by benchmarks/accuracy.py, written between comments."""

import accuracy
import pytest
from peers.__main__ import HEAD

PAGE = accuracy.PAGE.read_text(encoding="utf8")


def test_the_page_has_a_place_for_every_table():
    page = PAGE
    for name in accuracy.TABLES:
        page = accuracy.replace_block(page, name, f"made {name}")
        assert f"accuracy.py {name} -->\nmade {name}\n<!-- end -->" in page
    tables = [line for line in page.splitlines() if line.startswith("| ---")]
    assert len(tables) == PAGE.count("\n| --- ") - len(accuracy.TABLES)
    with pytest.raises(ValueError, match=r"accuracy.py fits -->"):
        accuracy.replace_block(page, "fits", "")


def test_rk4_prints_its_error(capsys):
    accuracy.main(["--quick", "rk4"])
    name, head, _, first, _, _, machine, *_ = capsys.readouterr().out.splitlines()
    assert (name, head) == ("rk4", "| time | error |")
    time, error = first.strip("| ").split(" | ")
    assert time == "0.01 s" and 0 < float(error.removesuffix(" m")) < 1e-13
    assert "clothsim" in machine


def test_a_row_of_cost_has_the_fastest_of_both(monkeypatch):
    our_run = ("1e-06", "clothsim", "rk4", "5e-4", "0.1", "3%", "2e-07", "3e-07", "800", "")
    their_run = ("1e-06", "SciPy", "DOP853", "1e-6", "0.4", "5%", "4e-07", "5e-07", "900", "4.0")
    assert len(HEAD) == len(our_run)
    monkeypatch.setattr(accuracy, "measure", lambda *arguments, **options: ("data", []))
    runs = {1e-6: [our_run, their_run], 1e-9: [our_run]}
    monkeypatch.setattr(accuracy, "fastest", lambda data, errors: runs.get(errors[0], []))
    _, _, full_row, part_row, _ = accuracy.cost(scenes=["swing"])
    numbers = ("0.1 (3%)", "rk4", "2e-07, 3e-07 m")
    assert full_row == ("swing", "1e-06 m", *numbers, "0.4 (5%), DOP853", "4e-07, 5e-07 m", "4.0")
    assert part_row == ("swing", "1e-09 m", *numbers, "", "", "")


def test_a_row_of_contact_has_every_response(monkeypatch):
    runs = [
        {"scene": "s", "response": r, "method": m, "setting": dt, "evaluations": n, "error": e}
        for r, m, dt, n, e in (
            ("penalty", "dop853", 1e-3, 1000, 2e-5),
            ("penalty", "rk4", 1e-3, 1, 1.0),
            ("penalty", "dop853", 1e-5, 2000, 3e-12),
            ("penalty", "rk4", 2.5e-4, 4, 5.0),
            ("ray", "rk4", 3.125e-5, 6, 7.0),
        )
    ]
    monkeypatch.setattr(accuracy.contact, "compare", lambda: runs)
    head, row = accuracy.contact_errors()
    assert len(head) == 5
    assert row == ("s", "1,000: 2e-5 m; 2,000: 3e-12 m", "4: 5e+0 m", "6: 7e+0 m", "")
