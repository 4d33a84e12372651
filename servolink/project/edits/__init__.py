"""Projects made from projects: built, mirrored, merged, scaled, taught."""
