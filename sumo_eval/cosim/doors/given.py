"""`given:FILE`: an ADS that its owner wrote by value into the run folder, a class or a function of a notebook cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, said


def load_given(file: str, folder: Path | None) -> Any:
    """The class, function or object. Reading one runs code, as importing a file of the user's does."""
    import cloudpickle

    path = Path(folder or Path.cwd(), file)
    if not path.is_file():
        raise InputError(f"ADS `given:{file}`: there is no such file; the run folder that it was given to has moved.")
    try:
        return cloudpickle.loads(path.read_bytes())
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"ADS `given:{file}` cannot be read: {said(error)}.") from error
