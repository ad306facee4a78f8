"""Why a number of a report is NaN, or is worse than what was asked for."""

_NO_SUCH = "no such cloth moves like this, or the noise is not independent; errors have no meaning"


class Reason:
    """Reasons that reports, derivatives and fits give; `format` fills in the fields of some."""

    # These say why the error of a run is not known, or is too large (error_control.py).
    NOT_ASKED = "no estimate was asked for: give rtol, or estimate_error=True with dt"
    RESUMED = "the error of a resumed run is not estimated"
    ENDED_EARLY = "the run ended early: {stopped}"
    AT_REST = "a run to rest has no error in time"
    CONTACT = (
        "an obstacle responded after a step, which is no part of the equation: no error is told"
    )
    MISSED = "this run misses a sphere that a better run meets: no error can be told"
    LEAST = (
        "runs with more steps come no closer to each other, or cost more than {most:g} runs at "
        "the smallest tolerance"
    )
    APART = (
        "runs with smaller errors of each step do not approach each other: they end "
        "{distance:.2g} m apart"
    )
    UNSTABLE = "runs with more steps are unstable"
    NOT_REACHED = "{runs} runs did not reach the error that was asked for"
    NO_FINER = (
        "neither the smallest tolerance of a step nor {steps:,} steps reach the error that was "
        "asked for"
    )
    # These are about extremes and energies of a run (report.py).
    TOO_LARGE = "an energy is too large for a finite number"
    DRIVEN = "driven pins do work on the cloth"
    RESPONDED = "a {kind} responded, and responses change the energy"
    NO_STEP = "no step was taken"
    UNTOUCHED = "no sphere responded"
    NOT_WATCHED = "the graphics adapter does not watch the states between frames"
    # These are about the rest state (settle.py).
    NO_REST_ASKED = "not a run to rest: settle finds the rest state"
    RELAXED = "impulses of a relaxation have no meaning"
    MOST_EVALUATIONS = "max_evaluations = {most:,} did not suffice"
    NOT_HALVED = "the unbalanced force did not halve in {steps:,} steps"
    MOVES_AWAY = "the cloth moves away: no pin and no sphere holds it"
    # These are about derivatives (accuracy/solution.py and sensitivity.py).
    FAILED = "a run ended after {time:.4g} s: {error}"
    PARTED = "a {kind} responds after the step that begins at {time:.4g} s: motions part there"
    DISAGREE = "differences of two orders disagree from {time:.4g} s on: motions part there"
    # These are about parameters of a fit (accuracy/fit.py and residuals.py).
    NO_EFFECT = "has no effect on what was measured"
    COMBINED = (
        "only combinations are determined: the condition of the scaled Jacobian is {condition:.1e}"
    )
    AT_BOUND = "ends at its bound"
    VAGUE = "its error would be {error:.1g} times its value or scale"
    RIVAL = "{other:.4g} fits as well as {value:.4g}; bounds exclude one of them"
    # These are about a fit as a whole.
    EARLIER = "{derivatives}: give only the times before"
    LATE = "times seem to be off by {late:.3g} s: the first ones fit far better without it"
    FEW_NUMBERS = "only {free} numbers more than parameters do not tell sigma: give it"
    LARGE_CHI_SQUARE = "chi-square is {chi:.3g} per degree of freedom: " + _NO_SUCH
    SMALL_CHI_SQUARE = (
        "chi-square is {chi:.2g} per degree of freedom: sigma is larger than the noise, or the "
        "data was smoothed"
    )
    CORRELATED = (
        "residuals at neighbouring times have a correlation of {correlation:.2f}: " + _NO_SUCH
    )
    LARGE_RESIDUALS = (
        "residuals are {percent:.2g} % of the motion: " + _NO_SUCH + "; give sigma where noise is "
        "as large"
    )
