"""What a person sees while the run goes on: a live line on a terminal, few plain lines
elsewhere.
"""

import sys
import time as clock
from contextlib import suppress
from typing import TextIO

SECONDS_BETWEEN_LINES = 2.0
SHARE_BETWEEN_LINES = 0.05


class Progress:
    """Shows time, step, coupling iterations and the wall time left; made on every rank, shown on
    rank 0.
    """

    def __init__(
        self,
        total_time: float,
        quiet: bool = False,
        is_terminal: bool | None = None,
        start_time: float = 0.0,
        rank: int = 0,
        stream: TextIO | None = None,
    ) -> None:
        """Start the display.

        total_time, start_time : last and first simulated time [s] (start_time after a restart).
        is_terminal : None asks the stream (standard output).
        """
        stream = stream or sys.stdout
        is_terminal = stream.isatty() if is_terminal is None else is_terminal
        self.start = start_time
        self.end = total_time
        self._first = None
        show = _nothing if quiet or rank else _live_line if is_terminal else _plain_lines
        self._show = show(stream)
        next(self._show)

    def update(self, step: int, time: float, iterations: int) -> None:
        """Show the accepted step, its time [s] and its coupling iterations."""
        share = (time - self.start) / (self.end - self.start) if self.end > self.start else 1.0
        count = f"{iterations} coupling iteration{'s' if iterations != 1 else ''}"
        text = f"t = {time:.6g} s of {self.end:.6g} s, step {step}, {count}{self._left(time)}"
        self._show.send((text, share))

    def _left(self, time):
        """Return what is left by the pace since the first step, which compiles and makes all
        matrices.
        """
        now = clock.monotonic()
        if self._first is None:
            self._first = time, now
            return ""
        first, then = self._first
        return f", {_duration((self.end - time) / (time - first) * (now - then))} left"

    def close(self) -> None:
        """End the display and give the terminal back."""
        self._show.close()


def _nothing(stream):
    while True:
        yield


def _plain_lines(stream):
    """Print a line when 5 % more of the time is done and 2 s have passed since the last one, and
    the last line.
    """
    text = None
    shown = None
    last = (-1.0, float("-inf"))
    try:
        while True:
            text, share = yield
            now = clock.monotonic()
            if share >= last[0] + SHARE_BETWEEN_LINES and now >= last[1] + SECONDS_BETWEEN_LINES:
                _print(text, stream)
                shown = text
                last = (share, now)
    finally:
        if text != shown:
            _print(text, stream)


def _print(text, stream):
    with suppress(
        OSError
    ):  # a full disk or a reader that has gone: the results do not depend on this line
        print(text, file=stream, flush=True)


def _live_line(stream):
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (
        BarColumn(bar_width=20),
        TextColumn("{task.percentage:3.0f} %"),
        TextColumn("{task.description}"),
    )
    with Bar(*columns, console=Console(file=stream, force_terminal=True)) as bar:
        task = bar.add_task("starting", total=1.0)
        while True:
            text, share = yield
            bar.update(task, completed=share, description=text)


def _duration(seconds):
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return (
        f"{hours} h {minutes:02d} min"
        if hours
        else f"{minutes} min {seconds:02d} s"
        if minutes
        else f"{seconds} s"
    )
