"""`given:FILE`: an ADS that is a class or a function of a notebook cell. `evaluate` has pickled it
into the run folder.

Users: `cosim/doors/controller.py` finds `load_given` by name (`DOORS`).
"""

from pathlib import Path
from typing import Any

from sumo_eval.errors import users_code
from sumo_eval.input_file import read_input


def load_given(file: str, folder: Path) -> Any:
    """The class, function or object in a file of `folder`.

    Reading the file runs code, as importing a user's file does.
    """
    import cloudpickle

    content = read_input(folder / file, "ADS by value")
    with users_code(f"ADS `given:{file}` cannot be read"):
        return cloudpickle.loads(content)
