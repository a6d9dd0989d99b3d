"""`python -m qocjax.show`: one run, with its trajectory, an animation and the costmaps of the navigation stack."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("show", "show.ShowConfig", nav2=True, draws="qocjax.figures.shown")

if __name__ == "__main__":
    main.as_program()
