"""`onnx:policy.onnx`: a learned policy as the ADS; `policy.toml` has its inputs and outputs.

`cosim.doors.features` describes this table beside the model.
`onnx:policy.onnx?features=table.toml` names a different one, `output=NAME` an output other than the
first. Needs the extra `onnx`.

A network's last bits may depend on how many rows it is given at once. So every model is given
blocks of `BLOCK` rows (or as many as it is made for), filled up with zeros, on one thread, and a
case's answer does not depend on the other rows as far as the runtime treats the rows of a block
alike; tests check this for dense networks.
"""

from __future__ import annotations

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

BLOCK = 32  # rows that a model is given at once
_DTYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


class OnnxPolicy:
    """A model, how it is shown the world, and what its answers mean; one serves all cases."""

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
        self._output = self._checked_output(output)
        self._check_rows()

    def _check_rows(self) -> None:
        """Refuse a model that fails, or that answers a row differently among other rows."""
        rows = np.random.default_rng(1).uniform(0.0, 10.0, (BLOCK, len(self.interface.features)))
        try:
            among = self._answers(rows)[0]
            alone = self._answers(rows[:1])[0]
            if not np.allclose(among, alone, 1e-3, 1e-4, equal_nan=True):  # more than rounding
                raise ControllerError(
                    f"The model {self._name} must answer a row the same alone and among other "
                    f"rows (exported for evaluation, not for training), got {alone} and {among}"
                )
        except ControllerError as error:  # refused before the run
            raise InputError(f"{error}.") from error

    def _checked_input(self) -> tuple[str, Any, int]:
        owner = f"model {self._name}"
        given = self._session.get_inputs()
        if len(given) != 1:
            names = ", ".join(it.name for it in given)
            raise must_be("The inputs", owner, "one array (rows, features)", names or "none")
        (it,) = given
        what = f"The input `{it.name}`"
        shape = it.shape
        if it.type not in _DTYPES:
            raise must_be(what, owner, "of float or double numbers", it.type)
        wanted = len(self.interface.features)
        if len(shape) != 2 or (isinstance(shape[1], int) and shape[1] != wanted):
            must = f"of shape (rows, {wanted}), as its table has {wanted} features"
            raise must_be(what, owner, must, tuple(shape))
        rows = shape[0] or BLOCK
        return it.name, _DTYPES[it.type], rows if isinstance(rows, int) else BLOCK

    def _checked_output(self, output: str | None) -> str:
        owner = f"model {self._name}"
        given = {it.name: it for it in self._session.get_outputs()}
        output = next(iter(given), "") if output is None else output
        check_known(f"output of {owner}", given, output)
        it = given[output]
        # whether it names one of the discrete choices, by number
        self._chosen = it.type == "tensor(int64)" and self.interface.choices is not None
        if it.type not in _DTYPES and not self._chosen:
            raise must_be(f"The output `{output}`", owner, "of float or double numbers", it.type)
        return output

    def reset(self, briefing: Briefing) -> None:
        """Begin a batch: find for how many of its steps an answer holds."""
        owner = f"the features table of {self._name}"
        self._every = steps_between(self.interface.period or 0.0, briefing.step, owner)
        self._step = briefing.step

    def act(self, seen: Observations) -> FloatArray:
        """Accelerations, m/s2, and steering wheel angles, rad, (n, 2)."""
        if round(seen.time / self._step) % self._every == 0:
            answers = self._answers(self.interface.show(seen))
            self._held = np.zeros((int(seen.number.max()) + 1, 2))  # by case
            self._held[seen.number] = self.interface.commands(answers)
        return self._held[seen.number]

    def _answers(self, features: NDArray[Any]) -> NDArray[Any]:
        """Outputs of the model for rows of features, (n, `Interface.width`)."""
        n = len(features)
        rows = self._rows
        wanted = self.interface.width
        padded = np.zeros((n + rows, features.shape[1]), self._dtype)
        padded[:n], answers = features, np.empty((n + rows, wanted))
        for begin in range(0, n, rows):
            block = slice(begin, begin + rows)
            try:
                (answer,) = self._session.run([self._output], {self._input: padded[block]})
            except Exception as error:
                raise ControllerError(f"The model {self._name} failed: {_words(error)}") from error
            answer = np.asarray(answer)
            if self._chosen and answer.size == rows:
                if not ((answer >= 0) & (answer < wanted)).all():
                    raise ControllerError(
                        f"The output `{self._output}` of {self._name} must name choices "
                        f"0..{wanted - 1}, got {answer.min()}..{answer.max()}"
                    )
                answer = np.eye(wanted)[answer.reshape(rows)]
            if answer.shape != (rows, wanted) and not (wanted == 1 and answer.shape == (rows,)):
                raise ControllerError(
                    f"The output `{self._output}` of {self._name} must have the shape ({rows}, "
                    f"{wanted}) for {rows} rows, by the actions of its table, got {answer.shape}"
                )
            answers[block] = answer.reshape(rows, wanted)
        return answers[:n]


def from_locator(text: str, folder: Path) -> PolicyController:
    """`policy.onnx`, or `policy.onnx?features=table.toml&output=action`."""
    file, _, query = text.partition("?")
    options = read_query(query, f"ADS `onnx:{text}`", "features=FILE&output=NAME")
    check_known(f"option of ADS `onnx:{text}`", ("features", "output"), *options)
    table = folder / options["features"] if "features" in options else None
    policy = OnnxPolicy(folder / file, table, options.get("output"))
    # over arrays, as `batch` says
    return PolicyController(policy.act, policy)  # type: ignore[arg-type]


def _session(model: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise needs_extra("`onnx:`", "onnx") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise InputError(f"Model {model.name} cannot be loaded: {_words(error)}.") from error


def _words(error: Exception) -> str:
    """Words for an error of the runtime, without the place in its source code, which is long and
    stands before the reason.
    """
    return clean(re.sub(r"/\S+:\d+ .*?\) ", " ", f"{kind_of(error)}: {error}")).rstrip(" .")


def _external_data(model: Path) -> set[Path]:
    """Files that a model's weights lie in, as its protobuf message names them: the key `location`,
    the length of the name in one byte, the name.
    """
    # looked at, not passed over: the next key may be as near
    message = read_input(model, "model", 2**31)  # the most that protobuf allows
    found = re.findall(rb"(?s)\n\x08location\x12(.)(?=(.{0,127}))", message)
    return {model.parent / os.fsdecode(name[: ord(length)]) for length, name in found}
