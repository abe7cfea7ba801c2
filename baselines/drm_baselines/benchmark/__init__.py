"""The benchmark: frozen suites of manoeuvres, what is possible in them, and who flies them."""
