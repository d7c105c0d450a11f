"""Folders of texts."""


def lay(folder, files):
    """Write texts under their paths in a folder."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
