"""``python -m evopem``: the command ``evopem``."""

import sys


def main() -> int:
    """The command, which also an interruption while its modules load ends in one line."""
    try:
        from evopem.terminal import command

        return command.main()
    except KeyboardInterrupt:
        sys.stderr.write("\ninterrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
