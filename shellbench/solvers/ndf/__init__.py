"""The neural deformation field: a coordinate network for the displacement of a shell (PyTorch).

The way from a case to an answer, one module each: `inputs` (what the network sees of a point) -> `factors` (supports
and lift) -> `field` (network, extra features at points that carry a force, and the displacement) -> `geometry`
(strains) -> `energy` -> a recipe (`ritz`, the trainer, the published one) -> `solution`. Everything between inputs and
strains travels as second-order jets (`jets`): value, two first and three second derivatives.

Numbers that were tuned were tuned by certified energy or by stated uncertainty, never by a known value. Their comments
name the cases, and what happens on either side. "Not on record" says that no measurement of that is kept.
"""
