"""Observer, rewards, SAC training, evaluation and sweeps."""
