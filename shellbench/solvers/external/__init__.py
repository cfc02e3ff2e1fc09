"""Solvers that are commands of other programs, each described by a TOML file.

`solver` reads the file and calls the command once for each mesh of a ladder, `exchange` writes the meshes and reads the
results. It may import cases, decks and solutions of shells.
"""
