"""`python -m qocjax.show`: one run, with its trajectory, an animation and the costmaps of the navigation stack."""

from qocjax.commands.show import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
