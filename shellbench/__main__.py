"""The program ``shellbench``; ``python -m shellbench`` is the same."""

import sys

INTERRUPTED = 130  # what shells say of a program that Ctrl-C has ended


def main() -> None:
    """Run the command line; Ctrl-C is a sentence at any time, while modules are imported too."""
    try:
        from shellbench.cli import main as run

        run()
    except KeyboardInterrupt:
        print("shellbench: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
