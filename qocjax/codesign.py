"""`python -m qocjax.codesign`: the best design of the whole space, from a configuration to tables and figures."""

from qocjax.commands.codesign import main, run

__all__ = ["main", "run"]

if __name__ == "__main__":
    main()
