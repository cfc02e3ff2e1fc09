"""The exam examined: mutants of our own solvers, made by rule, go through the gate that a stranger faces.

    python -m tools.mutation --target fem --seed 1 --count 100

`operators` says what a mutant is, `targets` where mutants are made and where not, `draw` which of them are tried,
`exam` how one is examined in a process of its own, `schedule` in which order, and `report` what came of it.
"""
