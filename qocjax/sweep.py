"""`python -m qocjax.sweep`: the paper's study from a configuration to tables and figures."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("sweep", "study.StudyConfig", nav2=True, draws="qocjax.figures.study")

if __name__ == "__main__":
    main.as_program()
