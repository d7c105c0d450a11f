"""Result of `import libsumo` in a program of `traci:`: the `traci` beside this file. libsumo would
run a simulation in the program's own process, instead of sharing the case's.
"""

import sys

import traci

sys.modules["libsumo"] = traci
