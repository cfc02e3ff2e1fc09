"""The neural deformation field: a coordinate network for the displacement of a shell (PyTorch).

Data flow from a case to an answer, one module each: `inputs` (inputs of the network at a point) -> `factors` (supports
and lift) -> `field` (network, extra features at points that carry a force, and the displacement) -> `geometry`
(strains) -> `energy` -> a recipe (`ritz`, the trainer, the published one) -> `solution`. All functions between inputs
and strains are second-order jets (`jets`): value, two first and three second derivatives.

Tuned constants were set by certified energy or by stated uncertainty, never by a known value. Their comments name the
cases, and the effect of smaller and larger values. "Not on record" means that no measurement is kept.
"""
