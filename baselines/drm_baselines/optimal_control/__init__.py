"""Optimal control: the convex programme of a manoeuvre and controllers that follow from it."""

from drm_baselines.support.extras import require

require("optimal control", "plan")
