"""What a case asks of every solution, from displacements to modes, and how each is measured.

It may import the parts of the question and the protocol of fields, and no solution.
"""
