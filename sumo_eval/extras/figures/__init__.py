"""Figures for papers from runs and studies, as vector or pixel files, for `sumo-eval plot`."""
