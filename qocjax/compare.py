"""`python -m qocjax.compare`: two or more studies on one QoC scale, as a table, a figure and a page."""

from qocjax.commands.command_line import Command
from qocjax.commands.quoting import as_options

__all__ = ["main"]

main = Command("compare", "compare.CompareConfig", rewrite=as_options)

if __name__ == "__main__":
    main.as_program()
