"""Meanings of exit statuses.

Users: `cli/compare.py`, `cli/finish.py`, `cli/run.py`, `cli/tools.py`, `extras/rates/command.py`,
`extras/studies/boundary_command.py`, `extras/studies/qualify_command.py`,
`extras/wheel/command.py`.
"""

DONE = 0  # done, and every gate passed
GATE_FAILED = 1
INPUT_WRONG = 2  # an error message on stderr, no traceback
NOT_EVALUATED = 3  # some cases could not be evaluated; they are listed and counted
INTERRUPTED = 130  # Ctrl-C
NOT_READ = 141  # the reader of stdout has closed it, as `| head` does
