"""What people and machines read of a scored run: the HTML report, the terminal's table, cases.csv
and scores.json.
"""
