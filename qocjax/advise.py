"""`python -m qocjax.advise`: from a network or a trace to one page of advice, a figure and ROS 2 parameters."""

from qocjax.commands.advise import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
