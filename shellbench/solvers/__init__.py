"""The solvers of shellbench: a folder for each solver, or for a family of solvers."""
