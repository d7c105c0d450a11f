"""One file a format: each turns a source's own layout into samples in SI units
(`found.ImportedSamples`).
"""
