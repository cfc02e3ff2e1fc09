"""A plug-in for tests: solvers whose answers are known in closed form, and that misbehave when asked to."""
