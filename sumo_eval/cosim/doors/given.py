"""`given:FILE`: a class or a function of a notebook cell, which `evaluate` pickled into the run
folder.
"""

from pathlib import Path
from typing import Any

from sumo_eval.errors import users_code
from sumo_eval.input_file import read_input


def load_given(file: str, folder: Path) -> Any:
    """The class, function or object of a file in `folder`.

    Reading it runs code, as importing a user's file does.
    """
    import cloudpickle

    content = read_input(folder / file, "ADS by value")
    with users_code(f"ADS `given:{file}` cannot be read"):
        return cloudpickle.loads(content)
