"""The fit with what is known of the lens beforehand: `--lens`, and what the metadata adds.

The plate is fitted by itself too, so that a lens that it contradicts is told. What the user gives
is kept, what the metadata adds is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from msgspec.structs import replace

from nlens_video.core.errors import LensFitError, Note, NoteKind
from nlens_video.core.known_lens import LensPrior
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.numbers import with_error
from nlens_video.graph.base.values import FoundLens
from nlens_video.stages.r_regression import Regression

_MOST_ERRORS = 3.0  # standard errors: what lies farther off is contradicted
_METADATA_LEFT_OUT = (
    "the metadata's lens does not go with the plate's blur and is left out; --lens gives another"
)


def fit_with_known(
    fit: Callable[[LensPrior], Regression], given: LensPrior, completed: LensPrior,
    size: tuple[int, int], frame: int,
) -> FoundLens:  # fmt: skip
    """Fit the lens of a frame with what is known of it.

    Args:
        fit: of the plate, combined with what is known; may raise LensFitError.
        given: what `--lens` tells.
        completed: that, and what only the metadata tells.
        size: columns and rows of the frame [px].
        frame: its index, kept in the fit.

    Raises:
        LensFitError: the plate tells no lens, or contradicts what `--lens` tells in part, and no
            whole lens is known.
    """
    alone = _tried(fit, replace(given, slope=None, focus=None, intercept=None))
    found = _tried(fit, given) if given.in_numbers else alone
    if isinstance(found, LensFitError):
        return _known_in_place(alone, found, given, completed, size, frame)
    warning = "" if isinstance(alone, LensFitError) else _contradiction(alone.fit, given)
    if completed.numbers != given.numbers:
        together = None
        if _errors_apart(found.fit, _added(given, completed)) <= _MOST_ERRORS:
            together = _tried(fit, completed)
        if isinstance(together, Regression):
            found = together
        else:
            warning = warning or _METADATA_LEFT_OUT
    return FoundLens(fit=found.fit, regression=found, warning=warning)


def _tried(fit: Callable[[LensPrior], Regression], known: LensPrior) -> Regression | LensFitError:
    try:
        return fit(known)
    except LensFitError as error:
        return error


def _known_in_place(
    alone: Regression | LensFitError, failure: LensFitError, given: LensPrior,
    completed: LensPrior, size: tuple[int, int], frame: int,
) -> FoundLens:  # fmt: skip
    """The lens that is known, where the fit with it fails.

    Raises:
        LensFitError: it is not known wholly.
    """
    if isinstance(alone, LensFitError):
        if not completed.complete:
            raise failure
        fit = LensFit.of_known(completed, *size, frame)
        return FoundLens(fit=fit, regression=None, warning=_of_known_alone(given, completed))
    if not completed.complete:
        raise LensFitError(
            f"--lens does not go with the plate, which tells {_words(alone.fit)} without it; "
            "correct --lens, or leave it out"
        ) from failure
    known = replace(
        LensFit.of_known(completed, *size, frame),
        method="the lens that is known, against what the plate tells",
    )
    warning = _contradiction(alone.fit, completed, least=0.0)
    return FoundLens(fit=known, regression=None, warning=warning)


def _of_known_alone(given: LensPrior, completed: LensPrior) -> str:
    """A note on whose the lens is, where the plate tells none."""
    source = "--lens" if given.in_numbers else "the metadata"
    if given.in_numbers and completed.numbers != given.numbers:
        source = "--lens and the metadata"
    return f"the plate tells nothing of its lens; it is that of {source}"


def _added(given: LensPrior, completed: LensPrior) -> LensPrior:
    """What the metadata adds to `--lens`."""
    slope, focus, intercept = (
        None if told == before else told
        for told, before in zip(completed.numbers, given.numbers, strict=True)
    )
    return replace(completed, slope=slope, focus=focus, intercept=intercept)


def _contradiction(fit: LensFit, known: LensPrior, least: float = _MOST_ERRORS) -> str:
    """A note where `--lens` lies more errors than `least` off a fit without it, else empty."""
    apart = _errors_apart(fit, known)
    if apart <= least:
        return ""
    return Note(
        f"--lens lies {apart:.1f} standard errors from what the plate tells without it "
        f"({_words(fit)}) and is kept; check it, or leave it out",
        NoteKind.UNCERTAIN,
    )


def _words(fit: LensFit) -> str:
    return (
        f"slope {with_error(fit.slope, fit.slope_stderr)} and intercept "
        f"{with_error(fit.intercept, fit.intercept_stderr)}"
    )


def _errors_apart(fit: LensFit, known: LensPrior) -> float:
    """Standard errors by which what is known lies off a fit, off the nearer one where it has two.

    0 where nothing is known.
    """
    lenses = [(fit.slope, fit.intercept), *([] if fit.other is None else [fit.other])]
    return min(_errors_off(fit, slope, intercept, known) for slope, intercept in lenses)


def _errors_off(fit: LensFit, slope: float, intercept: float, known: LensPrior) -> float:
    """The same for one lens, with the errors of `fit`."""
    apart = []
    if known.slope is not None:
        apart.append((slope - known.slope.value, fit.slope_stderr, known.slope.error))
    if known.focus is not None:  # what is in focus has no CoC
        coc_px = slope * known.focus.value + intercept
        error = float(fit.coc_stderr_px(known.focus.value))
        apart.append((coc_px, error, slope * known.focus.error))
    if known.intercept is not None:
        off = intercept - known.intercept.value
        apart.append((off, fit.intercept_stderr, known.intercept.error))
    return max((abs(off) / max(math.hypot(*errors), 1e-9) for off, *errors in apart), default=0.0)
