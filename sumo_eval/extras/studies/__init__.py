"""Studies beside the scores: opinions of people, calibration and sensitivity of constants, the
boundary of an ADS's collisions, and the qualification of an installation.
"""
