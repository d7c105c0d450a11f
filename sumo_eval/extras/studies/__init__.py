"""Questions about scored runs: do people agree, what do the constants do, how do the scores
scale.
"""
