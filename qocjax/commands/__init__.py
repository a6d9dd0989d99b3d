"""The command lines: from options to files and a page in the terminal."""
