"""Pairwise arrays: few cases in which each value of a parameter meets each value of every other."""

import itertools


def pairwise(*columns):
    """Rows, one value of each column, in which every pair of values of two columns occurs.

    Greedy: a row begins with a pair that no row has yet, and each further value is the one that
    adds most new pairs to the row (after Cohen et al. 1997, the automatic efficient test
    generator).
    """
    sizes = [len(column) for column in columns]
    if len(sizes) < 2:
        return list(zip(*columns))
    missing = {
        ((i, a), (j, b))
        for i, j in itertools.combinations(range(len(sizes)), 2)
        for a in range(sizes[i])
        for b in range(sizes[j])
    }
    rows = []
    while missing:
        row = dict(min(missing))
        for i in sorted(set(range(len(sizes))) - set(row), key=lambda i: -sizes[i]):

            def new_pairs(a, i=i, row=row):
                return sum(tuple(sorted([(i, a), item])) in missing for item in row.items())

            turn = len(rows) % sizes[i]  # where values are equally good, one after the other
            row[i] = max(
                range(sizes[i]),
                key=lambda a, i=i, turn=turn: (new_pairs(a), -((a - turn) % sizes[i])),
            )
        missing -= set(itertools.combinations(sorted(row.items()), 2))
        rows.append(tuple(column[row[i]] for i, column in enumerate(columns)))
    return rows
