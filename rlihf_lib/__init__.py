"""Reinforcement learning from implicit human feedback: EEG in, aligned robot policies out."""

__version__ = "0.1.0"
