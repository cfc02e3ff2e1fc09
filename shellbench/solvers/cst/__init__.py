"""The discrete mesh that cloth simulators use: constant-strain triangles with hinges at their edges."""
