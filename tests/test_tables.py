"""`each` runs every row of a table and names the rows that fail."""

import pytest
import tables
from tables import each


@pytest.fixture(autouse=True)
def whole(monkeypatch):
    monkeypatch.setattr(tables, "alone", False)


def test_every_row_is_run_and_the_failing_ones_are_named(tmp_path):
    seen = []

    @each("a, b", [(1, 1), (2, 3), (4, 4), (5, 6)])
    def equal(a, b, folder):
        seen.append((a, folder))
        assert a == b

    with pytest.raises(AssertionError) as raised:
        equal(folder=tmp_path)
    assert [line.partition("}")[0] for line in str(raised.value).splitlines() if "{" in line] == [
        "{'a': 2, 'b': 3",
        "{'a': 5, 'b': 6",
    ]
    assert seen == [(a, tmp_path) for a in (1, 2, 4, 5)]


def test_an_error_that_is_not_raised_fails():
    @each("value", ["1", "x"])
    def refused(value):
        with pytest.raises(ValueError):
            int(value)

    with pytest.raises(AssertionError, match="'value': '1'"):
        refused()


def test_a_row_is_a_case_of_its_own_under_k(monkeypatch):
    monkeypatch.setattr(tables, "alone", True)
    for names, rows in (("a, b", [(1, 1), (2, 3)]), ("a", iter([1, 2]))):

        @each(names, rows)
        def test(a, b=0):
            pass

        [mark] = test.pytestmark
        assert mark.args[0] == names.replace(" ", "") and len(mark.args[1]) == 2
