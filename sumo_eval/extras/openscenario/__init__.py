"""OpenSCENARIO XML files (1.0 to 1.3) as logical scenarios: read with lxml, without network and
without entities.

`conformity` lists the elements that are played, ignored or refused. Parameters, expressions,
catalogs, places and moves are evaluated at a point of the file's space.
"""
