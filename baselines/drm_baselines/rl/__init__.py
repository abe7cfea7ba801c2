"""Reinforcement learning: Stable-Baselines3 and its contributions on batches of environments."""
