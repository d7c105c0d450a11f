"""How far a score can be trusted: intervals, risk, what the sample covers, and which further cases
would help most.
"""
