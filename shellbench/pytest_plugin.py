"""The pytest plug-in: `pytest --shellbench=SUITE --shellbench-solver=NAME` gates a solver."""
