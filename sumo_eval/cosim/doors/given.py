"""`given:FILE`: an ADS that its owner wrote by value into the run folder, a class or a function of
a notebook cell.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import read_input


def load_given(file: str, folder: Path | None) -> Any:
    """The class, function or object.

    Reading one runs code, as importing a file of the user's does.
    """
    import cloudpickle

    content = read_input(Path(folder or Path.cwd(), file), "ADS by value")
    try:
        return cloudpickle.loads(content)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"ADS `given:{file}` cannot be read: {said(error)}.") from error
