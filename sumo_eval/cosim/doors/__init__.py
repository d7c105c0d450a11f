"""The doors through which an ADS comes in: observations, TraCI code, programs, JSON lines, FMUs."""
