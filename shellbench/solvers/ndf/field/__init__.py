"""A displacement field: jets of functions, inputs and outputs of the network, and factors that hold the supports.

`build` builds a field from a case. `factors` applies the supports. The package contains no strains. It may import no
other package of `ndf`.
"""
