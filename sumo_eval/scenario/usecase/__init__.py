"""Use cases with pass criteria, written as Gherkin with a table of examples: each row a case, each `Then` a check."""
