"""What the residuals of a fit say: whether they are noise, and what the data determine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..base import Floats
from ..base.extras import import_from_extra
from ..run.reasons import Reason

EDGE = 1e-3  # distance [logarithms or scales] from a bound at which a value ends at it
# Residuals above this part of the motion (rms) are no noise, where no sigma is given.
LARGE = 0.02
# The data cannot tell parameters apart where singular values of columns of length 1 are below this
# part of the largest.
_SINGULAR = 1e-5
_PART = 1e-2  # least part of a parameter in a direction that is not determined
_SIGMAS = 5.0  # deviation [sigmas] of chi-square, or of a correlation, that is no chance
_LEAST_CORRELATION = 0.2  # least correlation of residuals at neighbouring times that is no noise
_SIGMAS_OF_CORRELATION = 3.0  # deviation [sigmas] of such a correlation that widens errors
_LEAST_FREE = 3  # least excess of numbers over parameters that tells sigma


def quality_and_misfit(
    minimum: Any,
    mask: Any,
    parameter_count: int,
    sigma: float | None,
    unit: float,
    least_residual: float,
    travel: float,
) -> tuple[dict[str, float], str]:
    """Return the quality of a minimum, and why its residuals are not noise, or "".

    The quality has sigma, chi-square per degree of freedom and the correlation of residuals at
    neighbouring times, as in `Fit.report`. The residuals of `minimum` are in units of `unit` [m];
    `least_residual` [m] is what residuals can show, `travel` [m] how far the cloth has moved, rms.
    """
    free = mask.sum() - parameter_count
    residuals = np.full(mask.shape, np.nan)
    residuals[mask] = minimum.fun[: mask.sum()]
    pairs = residuals[1:] * residuals[:-1]
    number = int(np.isfinite(pairs).sum())
    correlation = math.nan
    if number:
        square = max(np.nanmean(residuals**2), 1e-300)
        correlation = float(np.nansum(pairs) / number / square)
    chi = 2 * float(minimum.cost) / free
    if sigma is not None:
        quality = {"sigma": sigma, "chi_square": chi, "correlation": correlation}
        deviation = math.sqrt(2 / _effective_number_of_data(free, correlation, mask))
        if chi > 1 + _SIGMAS * deviation:
            return quality, Reason.LARGE_CHI_SQUARE.format(chi=chi)
        return quality, ""
    noise = unit * math.sqrt(chi)
    quality = {
        "sigma": max(noise, least_residual),
        "chi_square": math.nan,
        "correlation": correlation,
    }
    chance = max(_LEAST_CORRELATION, _SIGMAS / math.sqrt(max(number, 1)))
    reason = ""
    if free < _LEAST_FREE:
        reason = Reason.FEW_NUMBERS.format(free=free)
    elif noise > 10 * least_residual and correlation > chance:
        reason = Reason.CORRELATED.format(correlation=correlation)
    elif noise > max(10 * least_residual, LARGE * travel):
        reason = Reason.LARGE_RESIDUALS.format(percent=100 * noise / travel)
    return quality, reason


def is_significant_correlation(correlation: float, mask: Any) -> bool:
    """Return whether a correlation of residuals at neighbouring times is no chance."""
    number = int((mask[1:] & mask[:-1]).sum())
    return number > 0 and correlation > _SIGMAS_OF_CORRELATION / math.sqrt(number)


def _effective_number_of_data(free: int, correlation: float, mask: Any) -> float:
    """Return the number of independent data whose chi-square scatters as much as that of these."""
    rho = correlation if is_significant_correlation(correlation, mask) else 0.0
    return free * (1 - rho**2) / (1 + rho**2)


def reason_of_small_chi_square(quality: Mapping[str, float], free: int, mask: Any) -> str:
    """Return why chi-square is far below 1, or "".

    Its cube root is nearly normal (Wilson and Hilferty).
    """
    chi = quality["chi_square"]
    part = 2 / (9 * _effective_number_of_data(free, quality["correlation"], mask))
    if chi > max(1 - part - _SIGMAS * math.sqrt(part), 0.0) ** 3:
        return ""
    return Reason.SMALL_CHI_SQUARE.format(chi=chi)


def covariance_of_correlated_residuals(
    covariance: Floats, jacobian: Floats, mask: Any, correlation: float
) -> Floats:
    """Return the covariance where residuals k times apart have the correlation to the k-th."""
    rows = np.zeros((mask.size, jacobian.shape[1]))
    rows[mask.ravel()] = jacobian
    rows = rows.reshape(len(mask), -1, jacobian.shape[1])
    forward = rows.copy()
    backward = rows.copy()
    for k in range(1, len(rows)):
        forward[k] += correlation * forward[k - 1]
        backward[-1 - k] += correlation * backward[-k]
    sums = np.einsum("tnp,tnq->pq", rows, forward + backward - rows)
    return np.asarray(covariance @ sums @ covariance)


def one_sigma_of_student(degrees_of_freedom: int) -> float:
    """Return the one-sigma quantile of Student's t: sigma is estimated from so many numbers."""
    special = import_from_extra("scipy.special", "fit", "fit")
    return float(
        special.stdtrit(max(degrees_of_freedom, _LEAST_FREE), 0.5 + math.erf(math.sqrt(0.5)) / 2)
    )


def rival_minima(
    best: Any, minima: list[Any], scale: float, covariance: Floats
) -> dict[int, Floats]:
    """Return other minima that the data does not rule out, by the parameter that differs there.

    `scale` times a cost is chi-square.
    """
    places: dict[int, Floats] = {}
    errors = np.sqrt(np.diag(covariance))
    for minimum in minima:
        if scale * (minimum.cost - best.cost) < _SIGMAS**2:
            is_far = np.abs(minimum.x - best.x) > np.maximum(_SIGMAS * errors, _PART)
            for k in np.flatnonzero(is_far):
                places.setdefault(int(k), minimum.x)
    return places


class Determination(NamedTuple):
    """The covariance of the parameters, and reasons why some are not determined."""

    covariance: Floats  # covariance of the coordinates
    condition: float  # condition of the Jacobian with columns of length 1
    reasons: list[str]  # reason why a parameter is not determined, or ""


def judge_determination(
    jacobian: Floats, ends: Sequence[str], u: Floats, bounds: Floats
) -> Determination:
    """Return what the data determine at the coordinates `u`.

    `jacobian` is in sigmas per coordinate. `ends` has the reasons why derivatives are not known at
    the last times, which come before others.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    has_effect = lengths > 0
    unit_columns = jacobian / np.where(has_effect, lengths, 1.0)
    _, singular, right = np.linalg.svd(unit_columns, full_matrices=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
    strong = singular > _SINGULAR * singular[0]
    inverse = np.zeros((len(u), len(u)))
    if strong.any():
        inverse = right[strong].T / singular[strong] ** 2 @ right[strong]
    safe = np.where(has_effect, lengths, np.inf)
    covariance = inverse / np.outer(safe, safe)
    weak = np.abs(right[~strong] / safe)
    vague = (weak > _PART * weak.max(axis=1, keepdims=True)).any(axis=0)
    near_bound = np.minimum(u - bounds[0], bounds[1] - u) <= EDGE
    reasons = list(ends)
    for k, error in enumerate(np.sqrt(np.diag(covariance))):
        if reasons[k]:
            continue
        if not has_effect[k]:
            reasons[k] = Reason.NO_EFFECT
        elif vague[k]:
            reasons[k] = Reason.COMBINED.format(condition=condition)
        elif near_bound[k]:
            reasons[k] = Reason.AT_BOUND
        elif error > 1:
            reasons[k] = Reason.VAGUE.format(error=error)
    return Determination(covariance, condition, reasons)
