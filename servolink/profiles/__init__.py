"""Profiles: settings, limits and evidence of boards, by given name."""
