"""Meanings of exit statuses."""

from typing import Final

DONE: Final = 0  # done, and every gate passed
GATE_FAILED: Final = 1
INPUT_WRONG: Final = 2  # one clear sentence on stderr, no traceback
NOT_EVALUATED: Final = 3  # some cases could not be evaluated; they are listed and counted
INTERRUPTED: Final = 130  # Ctrl-C
NOT_READ: Final = 141  # the reader of stdout has closed it, as `| head` does
