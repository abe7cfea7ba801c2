"""Searches with Optuna: gains of control laws and settings of learning."""
