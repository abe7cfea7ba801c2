"""``drm sweep``: Monte Carlo over payload, misreport and policy, a million episodes if need be."""
