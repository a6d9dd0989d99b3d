"""`python -m qocjax.sweep`: the paper's study from a configuration to tables and figures."""

from qocjax.commands.sweep import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
