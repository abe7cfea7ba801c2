"""The benchmark's records as tables, targets, figures and one HTML page."""
