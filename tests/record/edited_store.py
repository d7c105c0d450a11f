"""A facts file that says something else than what was simulated, with hashes that fit: as another
machine wrote it."""

import sqlite3

from sumo_eval.record.case_rows import hash_of
from sumo_eval.record.store import Store


def edit(path, change, *, hashes=False):
    """Run one SQL statement on a facts file.

    hashes: give every case, and the run, the hash of what it is then.
    """
    connection = sqlite3.connect(path)
    with connection:
        connection.execute(change)
        for fact in connection.execute("SELECT * FROM facts").fetchall() if hashes else ():
            (beside,) = connection.execute(
                'SELECT * FROM circumstances WHERE "case" = ?', fact[:1]
            ).fetchall()
            query = 'SELECT vehicle, data FROM trajectories WHERE "case" = ? ORDER BY vehicle'
            found = hash_of(fact, beside[:-1], connection.execute(query, fact[:1]).fetchall())
            connection.execute(
                'UPDATE circumstances SET hash = ? WHERE "case" = ?', (found, fact[0])
            )
    connection.close()
    if hashes:
        store = Store(path, create=True)
        store.seal()
        store.close()
