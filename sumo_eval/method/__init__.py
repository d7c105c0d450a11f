"""The paper: its equations as functions, arrays in and values out.

No files, no plots, no simulator. Which file holds which equation: docs/formulas.md.
"""
