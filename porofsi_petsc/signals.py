"""Signals that ask for the end: an exception where nothing is under way, a note where a run can
still write its state.
"""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

# Ctrl-C and scancel -s INT, the end of a job's time, the warning before it, the end of a terminal.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
PAUSE = 0.02  # [s] after which `interrupt` looks again whether an import is over

_noted = 0


class Interrupted(BaseException):
    """A signal ends the program here and now; no Exception, so that nobody takes it for a failure
    of what was under way.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by signal {signal.Signals(number).name}")


def note(number: int, frame: FrameType | None) -> None:
    """Keep the first signal for `noted`; a second SIGINT ends the program at once (a handler)."""
    global _noted
    if _noted and number == signal.SIGINT:
        raise Interrupted(number)
    _noted = _noted or number


def interrupt(number: int, frame: FrameType | None) -> None:
    """End the program at the first signal and at every SIGINT (a handler); what else follows,
    mpirun's SIGTERM, is no news.

    An import is finished first: interrupted in one, Python forgets a library that has started
    (MPI), and some make errors of it.
    """
    global _noted
    first = not _noted
    _noted = _noted or number
    if first and _importing(frame):
        signal.signal(signal.SIGALRM, _retry)
        signal.setitimer(signal.ITIMER_REAL, PAUSE, PAUSE)
    elif first or number == signal.SIGINT:
        raise Interrupted(number)


def _retry(number: int, frame: FrameType | None) -> None:
    """End the program when the import is over, if it is still to be ended at once."""
    if not _importing(frame):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if _noted and signal.getsignal(_noted) is interrupt:
            raise Interrupted(_noted)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def noted() -> int:
    """Return the number of a signal that has come, 0 without one."""
    return _noted


def forget() -> None:
    """Forget the signal that has come: it has been answered."""
    global _noted
    _noted = 0


@contextmanager
def answered_by(handler: Callable) -> Iterator[None]:
    """Let a handler, `note` or `interrupt`, answer the ENDING signals meanwhile.

    One that is ignored (nohup, a job in the background) stays so; a thread that is not the main one
    may not say.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with restored(ENDING):
        for number in ENDING:
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, handler)
        yield


@contextmanager
def restored(numbers: Iterable[int]) -> Iterator[None]:
    """Give the signals the handlers of before at the end, whatever (a library that starts) has set
    meanwhile.
    """
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in before.items():
                if handler is not None:
                    signal.signal(number, handler)
