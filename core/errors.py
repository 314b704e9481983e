"""The one exception that a wrong input raises: a sentence the user can act on."""

from __future__ import annotations


class InputError(ValueError):
    """A wrong input, said in one sentence: parameter, constraint, value received, what to do.

    The command line prints the sentence and exits with code 2; from Python it is a ``ValueError``.
    """
