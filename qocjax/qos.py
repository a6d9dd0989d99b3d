"""`python -m qocjax.qos`: BEST_EFFORT against RELIABLE, from a configuration to tables and figures."""

from qocjax.commands.qos import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
