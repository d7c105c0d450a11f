"""Outputs of a scored run: the HTML report, the terminal's table, cases.csv and scores.json."""
