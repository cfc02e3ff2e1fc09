"""Third-party mechanics: the physics engine MuJoCo computes the motion of cloth for a case."""
