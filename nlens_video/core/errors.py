"""Every error that the program answers for: one line for a person, one exit code for a script."""

from __future__ import annotations


class NlensError(Exception):
    """Base of all errors with a clear line: what came, what was expected, what to do.

    Attributes:
        exit_code: status that the command line ends with.
    """

    exit_code = 1


class UsageError(NlensError):
    """An argument, an option or a pipeline file is wrong."""

    exit_code = 2


class InputError(NlensError):
    """The plate (video, picture, stream, layers) cannot be read."""

    exit_code = 3


class SceneError(NlensError):
    """The glTF scene cannot be used."""

    exit_code = 4


class LensFitError(NlensError):
    """No usable lens fit, and none was given."""

    exit_code = 5


class OutOfViewError(LensFitError):
    """No frame shows the object, so there is nothing to fit the lens on."""


class OutputError(NlensError):
    """The result cannot be written."""

    exit_code = 6


class ReaderGone(OutputError):
    """Whoever reads our standard output has closed it: an end, not a failure."""

    exit_code = 0
