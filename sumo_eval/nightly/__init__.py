"""One night after another: evaluate, compare with the last good night, keep a history."""
