"""The engine's step written a second time: in C, with NumPy and with numba."""
