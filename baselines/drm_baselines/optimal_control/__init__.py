"""Optimal control: the convex programme of a manoeuvre and controllers that follow from it."""
