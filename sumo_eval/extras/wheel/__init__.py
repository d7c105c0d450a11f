"""Driving in the browser on the harness's own loop: single drives, studies, and their results.

`hands` makes commands from keys, wheels and sticks. `tape` is the record of a drive, which can be
repeated to the same bytes. `seat` is the controller that keeps real time. `window` is the server
for the browser, with its `page` and its `messages`. In the window, `trip` has one person drive, and
`study` carries out a `plan` with participants. `quality` and `outcome` are the results.
"""
