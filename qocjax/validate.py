"""`python -m qocjax.validate`: the surrogate law held against measured runs, to tables and figures."""

from qocjax.commands.validate import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
