"""Other people's mechanics: Kratos Multiphysics, set up from a case and asked for its answer."""
