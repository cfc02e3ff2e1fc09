"""Test of the exam: mutants of the built-in solvers, made by rule, are judged like third-party solvers.

    python -m tools.mutation --target fem --seed 1 --count 100

`operators` defines mutants, `targets` the code that is mutated, `draw` the sample, `exam` the judgement of one mutant in a
process of its own, `schedule` the order, and `report` the results.
"""
