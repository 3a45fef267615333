"""The base of every error that is meant for the user: one line that names the thing, its value and the limit."""

from __future__ import annotations


class GrainScatterError(ValueError):
    """A user's error. The command line prints its text in one line; any other exception is a bug."""


class RunFileError(GrainScatterError):
    """A product of a run that is missing, cut short or not what it claims to be; names the file and the value."""
