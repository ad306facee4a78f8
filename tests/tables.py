"""One test for all rows of a table."""

import functools
import inspect

import pytest

single_rows = False  # rows as cases of their own: set by conftest.py under -k


def each(names, rows):
    """Run the test for every row of values of the arguments `names`, and name every row that fails.

    As `pytest.mark.parametrize`, but as one case: for tables of which a row takes next to no time.
    Fixtures are made once for all rows. Under ``-k`` each row is a case of its own, so that ``-k``
    can choose a row.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    if single_rows:
        return pytest.mark.parametrize(",".join(names), list(rows))
    rows = [row if len(names) > 1 else (row,) for row in rows]

    def decorate(test):
        @functools.wraps(test)
        def all_rows(**fixtures):
            failures = []
            for row in rows:
                values = dict(zip(names, row, strict=True))
                try:
                    test(**fixtures, **values)
                except (Exception, pytest.fail.Exception) as error:
                    failures.append((values, error))
            if failures:
                lines = [f"{values}: {type(error).__name__}: {error}" for values, error in failures]
                raise AssertionError("\n".join(lines)) from failures[0][1]

        signature = inspect.signature(test)
        parameters = [
            parameter for name, parameter in signature.parameters.items() if name not in names
        ]
        all_rows.__signature__ = signature.replace(parameters=parameters)
        return all_rows

    assert rows, names
    return decorate
