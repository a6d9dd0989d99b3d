"""`python -m qocjax.fleet`: how many robots a network carries, and what they need of it."""

from qocjax.commands.fleet import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
