"""`python -m qocjax.qos`: BEST_EFFORT against RELIABLE, from a configuration to tables and figures."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("qos", "qos.QosConfig")

if __name__ == "__main__":
    main.as_program()
