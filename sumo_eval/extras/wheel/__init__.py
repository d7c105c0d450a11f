"""Driving in the browser on the harness's own loop: single drives, studies, and their results.

`hands` makes commands of keys, wheels and sticks; `tape` is the record of a drive, from which it
can be repeated to the same bytes; `seat` is the controller that keeps real time; `window` is the
server that the browser talks to, with its `page` and its `messages`; `trip` and `study` run in it,
one drive or a whole study by its `plan`; `quality` and `outcome` are the results.
"""
