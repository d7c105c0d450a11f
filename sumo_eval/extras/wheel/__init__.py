"""A person at the wheel: drives in the browser on the harness's own loop, studies, and what comes
of them.

`hands` makes commands of keys, wheels and sticks; `tape` is the record of a drive, from which it
can be driven again to the same bytes; `seat` is the controller that keeps real time; `window` is
the server that the browser talks to; `trip` and `study` are what happens in it, one drive or a
whole study.
"""
