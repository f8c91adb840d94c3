"""Recordings to p(error): everything about EEG, nothing about robots."""
