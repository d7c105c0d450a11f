"""The longitudinal MPC of openpilot (https://github.com/commaai/openpilot, releases 0.8.13 and
0.8.14) as an ADS.

    pip install comma-deps-acados casadi setuptools          # and a C compiler: the solver is generated and compiled
    sumo-eval run --ads "openpilot_long.py:Longitudinal?options.source=/home/me/openpilot" --ads idm

`long_mpc.py` runs as it is in the checkout; what it imports of the rest of openpilot is five small
functions, which stand in here. What is around it, limits of the acceleration and the filtered
speed, is what its longitudinal planner does 20 times a second. Leads are what a perfect radar would
see. It does not steer.
"""

import contextlib
import ctypes
import importlib.util
import io
import os
import sys
import tempfile
import time
import types
from pathlib import Path
from types import SimpleNamespace

import acados
import numpy as np

FILE = "selfdrive/controls/lib/longitudinal_mpc_lib/long_mpc.py"
DT, TAU = 0.05, 1.5  # s, s: the planner's step, and for how long a lead keeps its acceleration
# m/s2 when cruising, over m/s
LOWEST, HIGHEST = -1.2, ((0.0, 15.0, 25.0, 40.0), (1.2, 1.2, 0.8, 0.6))
QUIET = contextlib.redirect_stdout


class Longitudinal:
    @classmethod
    def load_once(cls, source):
        """Generate the solver's C code from the checkout's own description, compile it, import the
        MPC."""
        os.environ["ACADOS_SOURCE_DIR"], os.environ["TERA_PATH"] = acados.DIR, acados.TERA_PATH
        os.environ["ACADOS_PYTHON_INTERFACE_PATH"] = acados.TEMPLATE_DIR
        from acados import acados_template

        cls.folder = tempfile.TemporaryDirectory(prefix="openpilot_")
        table = f"{cls.folder.name}/long.json"

        def solver(name, stages):
            with QUIET(io.StringIO()):
                return acados_template.AcadosOcpSolver(None, table, build=False, generate=False)

        log = SimpleNamespace(warning=lambda text: None)
        for name, content in {
            "common.realtime": {"sec_since_boot": time.monotonic},
            "common.numpy_fast": {
                "clip": lambda x, low, high: max(low, min(high, x)),
                "interp": np.interp,
            },
            "selfdrive.swaglog": {"cloudlog": log},
            "selfdrive.modeld.constants": {
                "index_function": lambda i, max_val, max_idx: max_val * (i / max_idx) ** 2
            },
            "selfdrive.controls.lib.radar_helpers": {"_LEAD_ACCEL_TAU": TAU},
            "selfdrive.controls.lib.longitudinal_mpc_lib.c_generated_code.acados_ocp_solver_pyx": {
                "AcadosOcpSolverFast": solver
            },
        }.items():
            parts = name.split(".")
            for end in range(1, len(parts) + 1):
                sys.modules.setdefault(
                    ".".join(parts[:end]), types.ModuleType(".".join(parts[:end]))
                )
            vars(sys.modules[name]).update(content)
        spec = importlib.util.spec_from_file_location("openpilot_long_mpc", Path(source) / FILE)
        cls.mpc = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(cls.mpc)
        vars(cls.mpc).update(
            EXPORT_DIR=f"{cls.folder.name}/c",
            AcadosModel=acados_template.AcadosModel,
            AcadosOcp=acados_template.AcadosOcp,
        )
        # the wheel's do not find each other
        for library in ("libblasfeo.so", "libhpipm.so", "libqpOASES_e.so.3.1"):
            ctypes.CDLL(f"{acados.LIB_DIR}/{library}", mode=ctypes.RTLD_GLOBAL)
        with QUIET(io.StringIO()):
            acados_template.AcadosOcpSolver.generate(cls.mpc.gen_long_mpc_solver(), table)
            acados_template.AcadosOcpSolver.build(f"{cls.folder.name}/c", verbose=False)

    def __init__(self, source):
        self.solver = self.mpc.LongitudinalMpc()

    def reset(self, scenario):
        self.wanted, self.next, self.acceleration, self.speed, self.taus = (
            scenario.desired_speed,
            0.0,
            0.0,
            None,
            {},
        )

    def act(self, seen):
        if seen.time < self.next - 1e-9:
            return self.acceleration
        self.next = seen.time + DT
        v = seen.ego.speed
        self.speed = (
            v if self.speed is None else max(0.0, self.speed + DT / (2.0 + DT) * (v - self.speed))
        )
        self.solver.set_accel_limits(
            min(LOWEST, self.acceleration + 0.05),
            max(float(np.interp(v, *HIGHEST)), self.acceleration - 0.05),
        )
        self.solver.set_cur_state(self.speed, self.acceleration)
        radar = SimpleNamespace(leadOne=self.lead(seen.lead), leadTwo=self.lead(seen.second_lead))
        self.solver.update(None, radar, self.wanted)
        before, self.acceleration = (
            self.acceleration,
            float(np.interp(DT, self.mpc.T_IDXS, self.solver.a_solution)),
        )
        self.speed += DT * (self.acceleration + before) / 2.0
        return self.acceleration

    def lead(self, it):
        if it is None:
            return SimpleNamespace(status=False, modelProb=0.0)
        tau = TAU if abs(it.acceleration) < 0.5 else 0.9 * self.taus.get(it.number, TAU)
        self.taus[it.number] = tau
        return SimpleNamespace(
            status=True,
            dRel=it.gap,
            vLead=it.speed,
            aLeadK=it.acceleration,
            aLeadTau=tau,
            modelProb=1.0,
        )
