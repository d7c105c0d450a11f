"""`onnx:policy.onnx`: a learned policy as the ADS; the table `policy.toml` in the same folder
describes its inputs and outputs (`cosim/doors/features.py`).

`onnx:policy.onnx?features=table.toml` names another table, `output=NAME` an output other than the
first. Needs the extra `onnx`.

A network's last bits may depend on the number of rows that it receives at once. So every model
receives blocks of `BLOCK` rows (or as many as it is made for), filled up with zeros, on one thread.
A case's answer then does not depend on the other rows, if the runtime treats the rows of a block
alike; tests check this for dense networks.

Users: `cosim/doors/controller.py` finds `from_locator` by name (`DOORS`).
"""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.doors.controller import Briefing, PolicyController
from sumo_eval.cosim.doors.entry import read_query, steps_between
from sumo_eval.cosim.doors.features import read_interface
from sumo_eval.cosim.doors.observation import Observations
from sumo_eval.errors import ControllerError, InputError, check_known, must_be, needs_extra
from sumo_eval.input_file import input_file, read_input
from sumo_eval.text import clean, kind_of
from sumo_eval.trajectory import FloatArray

BLOCK = 32  # rows that a model receives at once
_DTYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


class OnnxPolicy:
    """A policy over arrays: a model, and the table of its inputs and outputs. One object serves all
    cases.

    table: file of the features table; None: beside the model.
    output: name of the output to use; None: the first.
    """

    batch = True

    def __init__(self, model: Path, table: Path | None, output: str | None) -> None:
        self._name = model.name
        input_file(model, "model")
        table = table or model.with_suffix(".toml")  # beside the model, unless it is named
        input_file(table, "features table")
        self.interface = read_interface(table)
        self._session = _session(model)
        self.files = tuple(sorted({model, table, *_external_data(model)}))
        self._input, self._dtype, self._rows = self._checked_input()
        self._output, self._chosen = self._checked_output(output)
        self._check_rows()

    def _check_rows(self) -> None:
        """Refuse a model that fails, or that answers a row differently among other rows."""
        # any numbers will do, the same at every start
        rows = np.random.default_rng(1).uniform(0.0, 10.0, (BLOCK, len(self.interface.features)))
        try:
            among, alone = self._answers(rows)[0], self._answers(rows[:1])[0]
        except ControllerError as error:  # of `_run`, here before any case
            raise InputError(f"{error}.") from error
        if not np.allclose(among, alone, 1e-3, 1e-4, equal_nan=True):  # more than rounding
            raise InputError(
                f"The model {self._name} must answer a row the same alone and among other rows "
                f"(exported for evaluation, not for training), got {alone} and {among}."
            )

    def _checked_input(self) -> tuple[str, Any, int]:
        """Name of the model's input, its type in numpy, and the rows that it takes at once.

        Raises InputError for an input that does not fit the table.
        """
        owner = f"model {self._name}"
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            names = ", ".join(it.name for it in inputs)
            raise must_be("The inputs", owner, "one array (rows, features)", names or "none")
        name, kind, shape = inputs[0].name, inputs[0].type, inputs[0].shape
        what = f"The input `{name}`"
        if kind not in _DTYPES:
            raise must_be(what, owner, "of float or double numbers", kind)
        columns = len(self.interface.features)
        if len(shape) != 2 or (isinstance(shape[1], int) and shape[1] != columns):
            must = f"of shape (rows, {columns}), as its table has {columns} features"
            raise must_be(what, owner, must, tuple(shape))
        rows = shape[0] or BLOCK
        return name, _DTYPES[kind], rows if isinstance(rows, int) else BLOCK

    def _checked_output(self, output: str | None) -> tuple[str, bool]:
        """Name of the output to use, and whether it is the number of one of the discrete choices,
        instead of their scores.

        Raises InputError if the model lacks the output, or if it is not of numbers.
        """
        owner = f"model {self._name}"
        kinds = {it.name: it.type for it in self._session.get_outputs()}
        output = next(iter(kinds), "") if output is None else output
        check_known(f"output of {owner}", kinds, output)
        kind = kinds[output]
        chosen = kind == "tensor(int64)" and self.interface.choices is not None
        if kind not in _DTYPES and not chosen:
            raise must_be(f"The output `{output}`", owner, "of float or double numbers", kind)
        return output, chosen

    def reset(self, briefing: Briefing) -> None:
        """Begin a batch: compute for how many of its steps an answer holds."""
        owner = f"the features table of {self._name}"
        self._every = steps_between(self.interface.period or 0.0, briefing.step, owner)
        self._step = briefing.step

    def act(self, seen: Observations) -> FloatArray:
        """Accelerations, m/s2, and steering wheel angles, rad, (n, 2)."""
        if round(seen.time / self._step) % self._every == 0:
            answers = self._answers(self.interface.show(seen))
            # by case: commands for this step and those until the next answer
            self._held = np.zeros((int(seen.number.max()) + 1, 2))
            self._held[seen.number] = self.interface.commands(answers)
        return self._held[seen.number]

    def _answers(self, features: NDArray[Any]) -> NDArray[Any]:
        """Outputs of the model for rows of features, (n, `Interface.width`)."""
        n, rows = len(features), self._rows
        padded = np.zeros((n + rows, features.shape[1]), self._dtype)
        padded[:n] = features
        blocks = [self._run(padded[begin : begin + rows]) for begin in range(0, n, rows)]
        return np.concatenate(blocks)[:n].astype(float)

    def _run(self, block: NDArray[Any]) -> Any:
        """Checked output of the model for one block, (rows, `Interface.width`)."""
        rows, width = self._rows, self.interface.width
        try:
            (answer,) = self._session.run([self._output], {self._input: block})
        except Exception as error:
            raise ControllerError(f"The model {self._name} failed: {_words(error)}") from error
        answer = np.asarray(answer)
        if self._chosen and answer.size == rows:
            answer = self._scores(answer.reshape(rows))
        if answer.shape != (rows, width) and not (width == 1 and answer.shape == (rows,)):
            raise ControllerError(
                f"The output `{self._output}` of {self._name} must have the shape ({rows}, "
                f"{width}) for {rows} rows, by the actions of its table, got {answer.shape}"
            )
        return answer.reshape(rows, width)

    def _scores(self, choices: NDArray[Any]) -> NDArray[Any]:
        """Scores (n, choices) for numbers of choices (n,): 1 for the choice, else 0."""
        width = self.interface.width
        if not ((choices >= 0) & (choices < width)).all():
            raise ControllerError(
                f"The output `{self._output}` of {self._name} must name choices "
                f"0..{width - 1}, got {choices.min()}..{choices.max()}"
            )
        return np.asarray(np.eye(width)[choices])


def from_locator(text: str, folder: Path) -> PolicyController:
    """`policy.onnx`, or `policy.onnx?features=table.toml&output=action`."""
    file, _, query = text.partition("?")
    options = read_query(query, f"ADS `onnx:{text}`", "features=FILE&output=NAME")
    check_known(f"option of ADS `onnx:{text}`", ("features", "output"), *options)
    table = folder / options["features"] if "features" in options else None
    return PolicyController(OnnxPolicy(folder / file, table, options.get("output")))


def _session(model: Path) -> Any:
    """The runtime's session of a model, on one thread, with the same bits each time."""
    try:
        import onnxruntime
    except ImportError as error:
        raise needs_extra("`onnx:`", "onnx") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors only
    try:
        return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise InputError(f"Model {model.name} cannot be loaded: {_words(error)}.") from error


def _words(error: Exception) -> str:
    """Message of an error of the runtime, without the place in the runtime's source code, a long
    text `/path:line function) ` before the reason.
    """
    return clean(re.sub(r"/\S+:\d+ .*?\) ", " ", f"{kind_of(error)}: {error}")).rstrip(" .")


def _external_data(model: Path) -> set[Path]:
    """Files with weights of a model, as its protobuf message names them: the key `location`, the
    length of the name, the name.
    """
    message = read_input(model, "model", 2**31)  # the most that protobuf allows
    files = set()
    # \n\x08: field 1, of 8 bytes. \x12: field 2, then its length in groups of 7 bits, the lowest
    # first. The highest bit of a byte is set unless it holds the last group.
    for key in re.finditer(rb"\n\x08location\x12([\x80-\xff]*[\x00-\x7f])", message):
        length = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(key[1]))
        files.add(model.parent / os.fsdecode(message[key.end() : key.end() + length]))
    return files
