"""`python -m qocjax.codesign`: the best design of the whole space, from a configuration to tables and figures."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("codesign", "codesign.CodesignConfig")

if __name__ == "__main__":
    main.as_program()
