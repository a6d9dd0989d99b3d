"""`python -m qocjax.ingest`: recorded runs to loop traces, quality of control and an account of what was found."""

from qocjax.commands.command_line import Command

__all__ = ["main"]

main = Command("ingest", "ingest.IngestConfig")

if __name__ == "__main__":
    main.as_program()
