"""RGB frames -> masks -> tracks -> 3D points -> Episode."""
