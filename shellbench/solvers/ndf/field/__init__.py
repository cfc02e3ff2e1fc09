"""A displacement field: jets of functions, what a network sees and gives, and factors that hold the supports.

How a field is built from a case: `build`. Where a support is applied: `factors`. Nothing here knows strains. It may
import no other room of `ndf`.
"""
