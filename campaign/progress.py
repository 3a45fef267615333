"""The progress of a campaign on a terminal: a bar, a length of time in words, one line that is written over."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence


def bar(done: int, total: int, width: int = 30) -> str:
    """Return a bar of `width` characters and the count, such as "[###---] 5/10 runs"."""
    return f"[{_hashes(done, total, width)}] {done}/{total} runs"


def progress_line(done: int, total: int, words: Sequence[str], width: int) -> str:
    """Return one line of at most `width` characters: a bar, which gets shorter or is left out, the count, and words.

    Where the words do not fit, the last but one is left out, and so on: the last one is the most important.
    """
    words = list(words)
    while True:
        text = " · ".join([f"{done}/{total} runs", *words])
        room = width - len(text) - len("[] ")
        if room >= 5:
            return f"[{_hashes(done, total, min(room, 30))}] {text}"
        if len(text) <= width or len(words) < 2:
            return text[:width]
        del words[-2]


def _hashes(done: int, total: int, width: int) -> str:
    filled = width * done // max(total, 1)
    return "#" * filled + "-" * (width - filled)


def span(seconds: float) -> str:
    """Return a length of time in a readable unit: s below 90 s, min below 90 min, else h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


class Progress:
    """One line on stderr: written over on a terminal, and appended every 20 s at most where stderr is a file."""

    def __init__(self, quiet: bool = False):
        self.live = sys.stderr.isatty()
        self.quiet, self.shown_at, self.text = quiet, time.monotonic(), ""

    @property
    def width(self) -> int:
        """Characters of a line: those of the terminal less one, 79 where stderr is a file."""
        return shutil.get_terminal_size().columns - 1 if self.live else 79

    def show(self, text: str) -> None:
        """Show a new text. A closed terminal raises no error, so that the campaign goes on."""
        now = time.monotonic()
        if self.quiet or text == self.text or not (self.live or now - self.shown_at > 20.0):
            return
        self.text, self.shown_at = text, now
        width = self.width
        self._write(f"\r{text[:width].ljust(width)}" if self.live else f"{text}\n")

    def end(self) -> None:
        """End the line on a terminal."""
        if self.live and self.text:
            self._write("\n")

    @staticmethod
    def _write(text: str) -> None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except OSError:
            pass
