"""``python -m evopem``: the command ``evopem``."""

import sys


def main() -> int:
    """Run the command; an interruption ends it in one line, also while its modules load."""
    try:
        from evopem.terminal import command

        return command.main()
    except KeyboardInterrupt:
        sys.stderr.write("\ninterrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
