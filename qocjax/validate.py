"""`python -m qocjax.validate`: the surrogate law held against measured runs, to tables and figures."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("validate", "validate.ValidateConfig", nav2=True)

if __name__ == "__main__":
    main.as_program()
