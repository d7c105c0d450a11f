"""Curved roads: their reference line, and positions along and across the road on the map."""
