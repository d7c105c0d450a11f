"""Values of the command line by name, NAME=VALUE.

Users: `cli/look.py`, `extras/openscenario/command.py`, `extras/studies/boundary_command.py`,
`extras/wheel/command.py`.
"""

from collections.abc import Iterable

from sumo_eval.errors import InputError


def named_values(texts: Iterable[str], option: str) -> dict[str, float]:
    """The numbers by name.

    option: subject of the errors: the option's name, or e.g. `A parameter`.
    Raises InputError for a text that is not NAME=VALUE with a number, and for a name given twice.
    """
    values = {}
    for text in texts:
        name, _, number = (part.strip() for part in text.partition("="))
        if name in values:
            raise InputError(f"{option} of each name must be given once, got `{name}` twice.")
        try:
            value = float(number)
        except ValueError:
            value = None
        if not name or value is None:
            raise InputError(f"{option} must have the form NAME=VALUE with a number, got {text!r}.")
        values[name] = value
    return values
