"""The linear shell at rest: the output layer solved for, and the solution that answers.

Levels of ever more features, challengers that say how sure the answer is, and contact. What a field can't hold is
declined here too. It may import `field` and `strains`.
"""
