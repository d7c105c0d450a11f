"""Roads that bend: their reference line, and where a place along and across the road lies on the
map.
"""
