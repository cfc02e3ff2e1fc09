"""``python -m shellbench`` is the same program as ``shellbench``."""

from shellbench.cli import main

if __name__ == "__main__":
    main()
