"""Running, recording, comparing and gating. This package knows no solver by name."""
