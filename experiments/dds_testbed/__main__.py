"""Robots and edge under a real middleware over an emulated radio: one run.

    python -m experiments.dds_testbed [option=value ...]        options and defaults: testbed.yaml

Needs Linux with network namespaces (root, or user namespaces), `ip`, and the extra of the middleware: `dds` for
middleware=cyclonedds, `ros2` for fastdds, `zenoh` for zenoh. Nothing leaves the namespaces, and they end with the run.
"""

from __future__ import annotations

import sys

from experiments.dds_testbed.namespaces import enter_private

__all__ = ["main"]


def main(arguments: list[str]) -> int:
    """Command line; 2 for bad input or a system that does not allow it, 3 for a run that is too late to count."""
    if {"-h", "--help"} & set(arguments):
        print(__doc__)
        return 0
    try:
        enter_private()  # before anything starts a thread
        from experiments.dds_testbed.run import run_and_write

        return 0 if run_and_write(arguments) else 3
    except (ValueError, TypeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
