"""Figures for papers: the paper's own and those alongside, from a scored run, as vector or pixel
files.
"""
