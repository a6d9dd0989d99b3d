"""`python -m qocjax.compare`: two or more studies on one QoC scale, as a table, a figure and a page."""

from qocjax.commands.compare import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
