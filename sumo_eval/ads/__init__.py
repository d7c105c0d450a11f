"""Controllers that ship, one rule a file, and the parts that they are made of.

Nothing here imports a simulator: a rule sees records of vehicles.
"""
