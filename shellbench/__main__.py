"""The program ``shellbench``; ``python -m shellbench`` is the same."""

import signal
import sys
from types import FrameType

INTERRUPTED = 130  # the shells' exit code of a program that Ctrl-C has ended; used here for other signals, too
TOLD_TO_END = (signal.SIGTERM, signal.SIGHUP)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal like Ctrl-C."""
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line; Ctrl-C, SIGTERM and SIGHUP print one sentence at any time, even during imports."""
    try:
        for number in TOLD_TO_END:
            if signal.getsignal(number) is signal.SIG_DFL:  # an ignored hang-up stays ignored, as nohup requires
                signal.signal(number, interrupt)
        from shellbench.cli import main as run

        run()
    except KeyboardInterrupt:
        print("shellbench: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
