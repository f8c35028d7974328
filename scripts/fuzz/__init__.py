"""Hostile scenes, damaged checkpoints, signals at random moments."""
