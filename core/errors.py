"""The one exception that a wrong input raises, and Mitsuba's messages made readable."""

from __future__ import annotations

import difflib
import re
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

STOPS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP  # what ends a run: Ctrl-C, a scheduler, a terminal that closes


class InputError(ValueError):
    """A wrong input, said in one sentence: parameter, constraint, value received, what to do.

    The command line prints the sentence and exits with code 2; from Python it is a ``ValueError``.
    """


def suggest(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the known name closest to `name`, or an empty string."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else ""


def one_sentence(error: BaseException) -> str:
    """Boil an exception that came through Mitsuba down to the sentence that matters.

    Parameters
    ----------
    error : BaseException
        What Mitsuba or a plugin raised. Dr.Jit wraps errors of a render in others, so the innermost
        cause is the one reported.

    Returns
    -------
    str
        One line, without C++ source positions and without a Python traceback.
    """
    error = _innermost(error)
    text = str(error).strip() or type(error).__name__

    # A Python plugin's exception arrives as the text of its traceback: its last line is the message.
    if "Traceback (most recent call last)" in text:
        text = re.sub(r"^[\w.]*(Error|Exception|Interrupt): ", "", text.splitlines()[-1])
    text = re.sub(r"\[\w+\.(?:cpp|h):\d+\]\s*", "", text)
    unknown = r"failed to instantiate \w+ plugin .*Plugin \"(\w+)\" not found!"
    text = re.sub(unknown, r"there is no plugin '\1'", text)
    if unused := re.search(r"Found unused parameters:\s*(.*)", text, re.DOTALL):
        names = ", ".join(f"'{n}'" for n in re.findall(r"\$(\w+)=", unused[1]))
        return f"the scene has no parameter {names}"

    # Unknown parameters come as a list over several lines: keep the names.
    found = re.search(r"Found \d+ unreferenced propert\w+ in (\w+) plugin of type \"(\w+)\"", text)
    if found:
        names = ", ".join(f"'{n}'" for n in re.findall(r"^\s*- [\w ]*\"([^\"]+)\"", text, re.MULTILINE))
        where = re.match(r"While loading (?!dictionary)(.*?): ", text)
        kind = "plugin" if found[1] == "unknown" else found[1]
        prefix = f"{where[1]}: " if where else ""
        return f"{prefix}{kind} '{found[2]}' has no parameter {names}"

    text = re.sub(r"(?:At|While loading) dictionary node \"\w+\"[^:]*: ", "", text)
    return re.sub(r"\s+", " ", text).strip()


def _innermost(error: BaseException) -> BaseException:
    """Return the cause that the wrappers hide: Dr.Jit's says only "see above"."""
    while not isinstance(error, InputError) and (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    return error


@contextmanager
def mitsuba_errors(prefix: str = "") -> Iterator[None]:
    """Turn whatever Mitsuba raises inside the block into an `InputError` of one sentence."""
    try:
        with interrupts():
            yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(prefix + one_sentence(error)) from error


@contextmanager
def finishing() -> Iterator[list]:
    """Hold back one interruption until the block is done, so that what has been computed is written; a second one counts.

    Yields
    ------
    list
        Not empty once one has come.
    """
    came: list = []
    if threading.current_thread() is not threading.main_thread():
        # Signals reach the main thread alone
        yield came
        return

    def note(number, _):
        came.append(number)
        restore()

    def restore():
        for which, handler in before.items():
            signal.signal(which, handler)

    # Only those that would raise
    before = {which: signal.signal(which, note) for which in STOPS if callable(signal.getsignal(which))}
    try:
        yield came
    finally:
        restore()


@contextmanager
def interrupts() -> Iterator[None]:
    """Raise an interruption as itself: Dr.Jit wraps it like any other error while it records a loop."""
    try:
        yield
    except Exception as error:
        if isinstance(_innermost(error), KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise
