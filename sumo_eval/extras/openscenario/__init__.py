"""OpenSCENARIO XML files (1.0 to 1.3) as logical scenarios: read with lxml, without network and
without entities.

What plays, what means nothing here and what is refused is listed in `conformity`. Everything that a
file says is evaluated at a point of its space, as a player does: parameters, expressions, catalogs,
places, moves.
"""
