"""`python -m qocjax.tune`: tuning by gradients, from a configuration to tables and figures."""

from qocjax.commands.tune import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
