"""Whether this installation on this machine may be believed: known answers, found again."""
