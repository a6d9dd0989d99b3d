"""`python -m qocjax.advise`: from a network or a trace to one page of advice, a figure and ROS 2 parameters."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("advise", "advise.AdviseConfig", short={"path": ("network=trace", "network.path")}, nav2=True)

if __name__ == "__main__":
    main.as_program()
