"""Figures for papers: the paper's own and those beside it, from a scored run, as vector or pixel
files.
"""
