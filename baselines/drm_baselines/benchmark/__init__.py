"""The benchmark: frozen suites of manoeuvres, what is possible in them, who flies them and how well."""
