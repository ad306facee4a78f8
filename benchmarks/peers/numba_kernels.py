"""The numba kernel, for uniform mass and no spheres; imported only where numba is installed."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

# A plane per component with a border of points that no spring reaches, twelve
# neighbours unrolled in one branch-free loop, RK4 in Nystroem's form
# (x' = x + h v + h^2/6 (a1 + a2 + a3), v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)), fastmath.
# What makes LLVM vectorise it: the shape is a constant of the compiled code, so that all of an
# array is one range for the check against overlap, and indices are unsigned, so that none needs to
# be asked whether it is negative.
# State (6, rows + 4, columns + 4), flat; `spring` (6 kinds, 3): stiffness, stiffness x rest
# length and damping per mass; `column` (4, columns), flat: 1 where there is a point 1 right,
# 1 left, 2 right, 2 left, else 0.

BORDER = 2


class Strided(NamedTuple):
    """Compiled for one shape: steps of a cloth or of a batch, and right-hand sides dy/dt."""

    serial: Callable[..., Any]
    parallel: Callable[..., Any]
    batch: Callable[..., Any]
    serial_slopes: Callable[..., Any]
    parallel_slopes: Callable[..., Any]


FAST: dict[str, Any] = {"fastmath": True, "error_model": "numpy"}


class Places(NamedTuple):
    """Distances in the arrays of one shape, unsigned."""

    rows: int
    columns: int
    n: Any  # a row without borders
    down: Any  # a row
    size: Any  # a plane without borders
    planes: tuple[Any, ...]  # of p planes, p = 0..5

    @classmethod
    def of(cls, shape: tuple[int, int]) -> Places:
        rows, columns = shape
        plane = (rows + 2 * BORDER) * (columns + 2 * BORDER)
        planes = tuple(np.uintp(p * plane) for p in range(6))
        return cls(
            rows,
            columns,
            np.uintp(columns),
            np.uintp(columns + 2 * BORDER),
            np.uintp(rows * columns),
            planes,
        )


# Numbers that a kernel takes from around it are constants of the compiled code.
_ONE, _TWO = np.uintp(1), np.uintp(2)


def _force_of_rows(places):
    """Make the kernel of the accelerations of a row."""
    rows, columns, n, down, size, (_, p1, p2, p3, p4, p5) = places
    one, two, size2 = _ONE, _TWO, np.uintp(2 * size)

    @njit(**FAST, inline="always")
    def pull(s, q, x, y, z, u, w, t, spring, n, present, unit):
        dx, dy, dz = s[q] - x, s[q + p1] - y, s[q + p2] - z
        du, dw, dt = s[q + p3] - u, s[q + p4] - w, s[q + p5] - t
        inverse = unit / math.sqrt(dx * dx + dy * dy + dz * dz)
        rate = spring[n, 2] * (du * dx + dw * dy + dt * dz)
        scale = present * (spring[n, 0] + (rate * inverse - spring[n, 1]) * inverse)
        return scale * dx, scale * dy, scale * dz

    @njit(**FAST, inline="always")
    def row_force(r, s, f, spring, column, gravity, free, unit):
        here = np.uintp(r + BORDER) * down + two
        out = np.uintp(r) * n
        up1, down1 = unit * (r >= 1), unit * (r + 1 < rows)
        up2, down2 = unit * (r >= 2), unit * (r + 2 < rows)
        g0, g1, g2 = gravity[0], gravity[1], gravity[2]
        for c in range(columns):
            i = np.uintp(c)
            q, o = here + i, out + i
            x, y, z, u, w, t = s[q], s[q + p1], s[q + p2], s[q + p3], s[q + p4], s[q + p5]
            right, left = column[i], column[i + n]
            e0 = pull(s, q + one, x, y, z, u, w, t, spring, 0, right, unit)
            e1 = pull(s, q - one, x, y, z, u, w, t, spring, 0, left, unit)
            e2 = pull(s, q + down, x, y, z, u, w, t, spring, 1, down1, unit)
            e3 = pull(s, q - down, x, y, z, u, w, t, spring, 1, up1, unit)
            e4 = pull(s, q + down + one, x, y, z, u, w, t, spring, 2, down1 * right, unit)
            e5 = pull(s, q - down - one, x, y, z, u, w, t, spring, 2, up1 * left, unit)
            e6 = pull(s, q + down - one, x, y, z, u, w, t, spring, 3, down1 * left, unit)
            e7 = pull(s, q - down + one, x, y, z, u, w, t, spring, 3, up1 * right, unit)
            e8 = pull(s, q + two, x, y, z, u, w, t, spring, 4, column[i + n + n], unit)
            e9 = pull(s, q - two, x, y, z, u, w, t, spring, 4, column[i + n + n + n], unit)
            ea = pull(s, q + down + down, x, y, z, u, w, t, spring, 5, down2, unit)
            eb = pull(s, q - down - down, x, y, z, u, w, t, spring, 5, up2, unit)
            m = free[o]
            f[o] = m * (
                e0[0]
                + e1[0]
                + e2[0]
                + e3[0]
                + e4[0]
                + e5[0]
                + e6[0]
                + e7[0]
                + e8[0]
                + e9[0]
                + ea[0]
                + eb[0]
                + g0
            )
            f[o + size] = m * (
                e0[1]
                + e1[1]
                + e2[1]
                + e3[1]
                + e4[1]
                + e5[1]
                + e6[1]
                + e7[1]
                + e8[1]
                + e9[1]
                + ea[1]
                + eb[1]
                + g1
            )
            f[o + size2] = m * (
                e0[2]
                + e1[2]
                + e2[2]
                + e3[2]
                + e4[2]
                + e5[2]
                + e6[2]
                + e7[2]
                + e8[2]
                + e9[2]
                + ea[2]
                + eb[2]
                + g2
            )

    return row_force


def _update_of_rows(places):
    """Make the kernel that updates a row by its accelerations, per stage."""
    _, columns, n, down, size, (_, p1, p2, p3, p4, p5) = places
    two, size2 = _TWO, np.uintp(2 * size)

    @njit(**FAST, inline="always")
    def move(q, o, s, state, f, out, h):
        out[q] = state[q] + h * s[q + p3]
        out[q + p1] = state[q + p1] + h * s[q + p4]
        out[q + p2] = state[q + p2] + h * s[q + p5]
        out[q + p3] = state[q + p3] + h * f[o]
        out[q + p4] = state[q + p4] + h * f[o + size]
        out[q + p5] = state[q + p5] + h * f[o + size2]

    @njit(**FAST, inline="always")
    def row_update(r, s, state, f, first, total, out, h, sixth, stage):
        here = np.uintp(r + BORDER) * down + two
        at = np.uintp(r) * n
        if stage == 0:
            for c in range(columns):
                q, o = here + np.uintp(c), at + np.uintp(c)
                move(q, o, s, state, f, out, h)
                first[o], first[o + size], first[o + size2] = f[o], f[o + size], f[o + size2]
        elif stage == 1:
            for c in range(columns):
                q, o = here + np.uintp(c), at + np.uintp(c)
                move(q, o, s, state, f, out, h)
                total[o], total[o + size], total[o + size2] = f[o], f[o + size], f[o + size2]
        elif stage == 2:
            for c in range(columns):
                q, o = here + np.uintp(c), at + np.uintp(c)
                move(q, o, s, state, f, out, h)
                total[o] += f[o]
                total[o + size] += f[o + size]
                total[o + size2] += f[o + size2]
        else:
            for c in range(columns):
                q, o = here + np.uintp(c), at + np.uintp(c)
                state[q] += h * (state[q + p3] + sixth * (first[o] + total[o]))
                state[q + p3] += sixth * (first[o] + f[o] + total[o] + total[o])
                o += size
                state[q + p1] += h * (state[q + p4] + sixth * (first[o] + total[o]))
                state[q + p4] += sixth * (first[o] + f[o] + total[o] + total[o])
                o += size
                state[q + p2] += h * (state[q + p5] + sixth * (first[o] + total[o]))
                state[q + p5] += sixth * (first[o] + f[o] + total[o] + total[o])

    return row_update


def _all_steps(places, row_force):
    """RK4 steps of a cloth in bands of rows."""
    rows, row_update = places.rows, _update_of_rows(places)

    # A band of rows a call: passing arrays costs a hundred nanoseconds in reference counts.
    @njit(**FAST)
    def band(begin, end, s, state, buffers, out, scene, h, time_step, stage):
        f, first, total = buffers
        spring, column, gravity, free = scene
        unit, _, _, sixth = time_step
        for r in range(begin, end):
            row_force(r, s, f, spring, column, gravity, free, unit)
            row_update(r, s, state, f, first, total, out, h, sixth, stage)

    def steps(count, bands, state, a, b, buffers, scene, time_step):
        _, h, half, _ = time_step
        for _ in range(count):
            for i in prange(bands):
                u, w = i * rows // bands, (i + 1) * rows // bands
                band(u, w, state, state, buffers, a, scene, half, time_step, 0)
            for i in prange(bands):
                u, w = i * rows // bands, (i + 1) * rows // bands
                band(u, w, a, state, buffers, b, scene, half, time_step, 1)
            for i in prange(bands):
                u, w = i * rows // bands, (i + 1) * rows // bands
                band(u, w, b, state, buffers, a, scene, h, time_step, 2)
            for i in prange(bands):
                u, w = i * rows // bands, (i + 1) * rows // bands
                band(u, w, a, state, buffers, state, scene, h, time_step, 3)

    return steps


def _batch_of(serial):
    """Make the kernel of the steps of a batch."""

    @njit(**FAST, parallel=True)
    def batch(count, bands, state, a, b, buffers, scene, time_step):
        # A cloth per thread: what belongs to a cloth has an axis of members first.
        f, first, total = buffers
        spring, column, gravity, free = scene
        for m in prange(state.shape[0]):
            member = (spring[m], column, gravity, free)
            sums = (f[m], first[m], total[m])
            serial(count, bands, state[m], a[m], b[m], sums, member, time_step)

    return batch


def _right_side(places, row_force):
    """dy/dt for a general solver: y and dy are six planes without borders, x and then v."""
    rows, columns, n, down, size, (_, p1, *_) = places
    two, size3 = _TWO, np.uintp(3 * size)

    def slopes(bands, y, dy, s, scene, unit):
        spring, column, gravity, free = scene
        f = dy[size3:]
        for i in prange(bands):
            for r in range(i * rows // bands, (i + 1) * rows // bands):
                here, at = np.uintp(r + BORDER) * down + two, np.uintp(r) * n
                for p in range(6):
                    for c in range(columns):
                        s[np.uintp(p) * p1 + here + np.uintp(c)] = y[
                            np.uintp(p) * size + at + np.uintp(c)
                        ]
        for i in prange(bands):
            for r in range(i * rows // bands, (i + 1) * rows // bands):
                at = np.uintp(r) * n
                for p in range(3):
                    for c in range(columns):
                        q = np.uintp(p) * size + at + np.uintp(c)
                        dy[q] = y[q + size3]
                row_force(r, s, f, spring, column, gravity, free, unit)

    return slopes


@lru_cache
def strided(shape):
    """Return the kernels for cloths of `shape`."""
    places = Places.of(shape)
    row_force = _force_of_rows(places)
    steps, slopes = _all_steps(places, row_force), _right_side(places, row_force)
    serial, parallel = njit(**FAST), njit(**FAST, parallel=True)
    step_rows = serial(steps)
    return Strided(
        step_rows, parallel(steps), _batch_of(step_rows), serial(slopes), parallel(slopes)
    )
