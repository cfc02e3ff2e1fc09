"""Sheets: a case as a person and any program with shell elements can take it.

`statement` says the question in words, `formats` writes its meshes with supports and loads for other programs, and
`sheet` makes both of a case. It may import cases, variants, symmetry, decks and portraits.
"""
