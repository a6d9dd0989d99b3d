"""`python -m qocjax.fleet`: how many robots a network carries, and what they need of it."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("fleet", "fleet.FleetConfig")

if __name__ == "__main__":
    main.as_program()
