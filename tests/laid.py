"""Folders of texts."""

import json


def lay(folder, files):
    """Write texts under their paths in a folder."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)


def read_json(path):
    """What a JSON file holds."""
    return json.loads(path.read_text())


def replace_in(path, old, new, count=-1):
    """Replace a text in a file, which must hold it."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
