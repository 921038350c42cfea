"""How long work tells its caller what it is doing."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is.

What it raises reaches the caller, and stops the work; `rigcal.Cancelled` is meant for that. No file
is left half-written, and no process goes on.
"""
