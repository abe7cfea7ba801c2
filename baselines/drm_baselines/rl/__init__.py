"""Reinforcement learning: PPO and SAC of Stable-Baselines3 on batches of environments."""
