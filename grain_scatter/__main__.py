"""The command `grain-scatter`: the command line of `campaign`, which finds its packages in the folder of this one."""

import sys

from grain_scatter import HOME


def main() -> int:
    """Run one command and return its exit code."""
    sys.path.insert(0, str(HOME))
    from campaign.__main__ import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
