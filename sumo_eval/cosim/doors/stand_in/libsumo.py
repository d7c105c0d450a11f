"""Result of `import libsumo` in a program of `traci:`: traci, as a library in the program's
process could not share the case's simulation.
"""

import sys

import traci

sys.modules["libsumo"] = traci
