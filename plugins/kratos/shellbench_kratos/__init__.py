"""Third-party mechanics: Kratos Multiphysics solves the cases."""
