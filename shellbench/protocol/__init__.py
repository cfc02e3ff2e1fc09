"""The base of the package, one module each: problem, quantity, solution, solver and kind of problem.

It imports `shellbench.errors` and `shellbench.files`, and nothing else of the package. Solvers, kinds and plug-ins
import its names from `shellbench.problem`.
"""
