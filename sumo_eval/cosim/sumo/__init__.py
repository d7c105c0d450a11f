"""SUMO's side: its files, a session of libsumo, a server of its own, its window."""
