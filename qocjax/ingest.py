"""`python -m qocjax.ingest`: recorded runs to loop traces, quality of control and an account of what was found."""

from qocjax.commands.ingest import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
