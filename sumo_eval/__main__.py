"""`python -m sumo_eval` is `sumo-eval`."""

from sumo_eval.cli import main

if __name__ == "__main__":
    main()
