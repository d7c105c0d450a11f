"""One file a format: each reads a source's own layout into samples and notes.

Samples are in SI units, of centres, y to the left. With `lane` they are in road coordinates;
without they are on a map (heading counter-clockwise) and have to be straightened. Notes are whole
sentences on assumptions.
"""
