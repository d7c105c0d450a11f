"""ADSs that a caller in Python gives as a class, a function or an object instead of a locator, for
example from a notebook's cell.

A class or a function in a file gets a locator of this file. Anything else is pickled into the run
folder by the user's own process; child processes only read it there.

Users: `record/facts.py`.
"""

import inspect
import sys
from pathlib import Path
from typing import Any

import cloudpickle

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import sha256, writing
from sumo_eval.record.run_folder import GIVEN, refuse_foreign
from sumo_eval.settings import AdsSettings


def entry_of(ads: Any, run: Path, *, resume: bool) -> AdsSettings:
    """The `[[ads]]` entry of an ADS that is a class, a function, an object or already an entry.

    run: folder of the run, which need not exist yet.
    resume: whether that folder may hold a run.
    """
    if isinstance(ads, AdsSettings):
        return ads
    has_name = inspect.isclass(ads) or inspect.isfunction(ads)
    name = (ads if has_name else type(ads)).__name__.strip("<>")  # `<lambda>` without brackets
    if has_name and (place := _place(ads)):
        return AdsSettings(name, place)
    try:
        data = cloudpickle.dumps(ads)
    except Exception as error:
        raise InputError(
            f"ADS `{name}` cannot be sent to the processes that drive: {said(error)}. Make what it "
            "holds in its constructor or in `reset`, or give its locator, `my_ads.py:Name`."
        ) from error
    refuse_foreign(run, resume)
    file = (run / GIVEN / f"{name}-{sha256(data)[:12]}.pickle").resolve()
    with writing(f"The run folder {run}", file.parent):
        file.write_bytes(data)
    return AdsSettings(name, f"given:{file}")


def _place(ads: Any) -> str:
    """`/path/my_ads.py:Name` of a class or a function at the top of a file that others can read;
    else "".
    """
    module_name, name = ads.__module__, ads.__qualname__
    module = sys.modules.get(module_name)
    file = getattr(module, "__file__", None) if module_name != "__main__" else None
    if not file or not file.endswith(".py") or getattr(module, name, None) is not ads:
        return ""
    return f"{module_name}:{name}" if "." in module_name else f"{Path(file).resolve()}:{name}"
