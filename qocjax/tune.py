"""`python -m qocjax.tune`: tuning by gradients, from a configuration to tables and figures."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("tune", "tune.TuneConfig")

if __name__ == "__main__":
    main.as_program()
