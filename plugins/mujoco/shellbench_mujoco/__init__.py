"""Other people's mechanics: cloth of MuJoCo, the physics engine, set up from a case and asked for its motion."""
