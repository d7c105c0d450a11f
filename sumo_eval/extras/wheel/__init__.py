"""Driving in the browser on the harness's own loop: single drives, studies, and their results.

`tape` is the record of a drive, from which it can be repeated to the same bytes; `seat` is the
controller that keeps real time and makes commands of keys, wheels and sticks; `window` is the
server that the browser talks to, with its `messages`; `trip`, with the page, and `study` run in it,
one drive or a whole study by its `plan`; `quality` and `outcome` are the results.
"""
